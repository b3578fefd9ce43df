// Appended to a comparison by test_comparison_browser.py: does what a reader does, and writes down what came of it.
const found = {}, at = (words) => document.querySelector(words), all = (words) => [...document.querySelectorAll(words)];
const heads = (id) => all(`${id} th`), cells = (id, n) => all(`${id} tbody tr`).map((row) => row.cells[n].textContent.trim());
const click = (id, n) => heads(id)[n].querySelector("button").click();
found.heads = heads("#runs").map((head) => head.textContent.trim());
const time = found.heads.indexOf("training");
found.before = cells("#runs", time);
click("#runs", time);
found.slowest_first = cells("#runs", time);
click("#runs", time);
found.fastest_first = cells("#runs", time);
found.aria = heads("#runs")[time].getAttribute("aria-sort");
click("#runs", 0);
found.as_named = cells("#runs", 0).map((text) => text.split(/\s/)[0]);
const last = heads("#classes").length - 1;
found.differences = cells("#classes", last).map(Number);
click("#pairs", 2);
found.p_down = all("#pairs tbody td:nth-child(3)").map((cell) => Number(cell.dataset.value));
const region = at("#runs .scroll");
region.focus();
found.region_has_focus = document.activeElement === region && region.getAttribute("aria-label") !== "";
region.scrollLeft = 50;
found.region_scrolls = region.scrollLeft;
found.unreachable = all("th button, a").filter((one) => one.tabIndex !== 0).length;
const strokes = (figure) => new Set([...figure.querySelectorAll("path")].map((path) => getComputedStyle(path).stroke));
found.plots = all("#curves figure").map((figure) => ({
  colors: [...strokes(figure)].filter((color) => color.startsWith("rgb")).length,
  width: figure.querySelector("svg").getBoundingClientRect().width,
  height: figure.querySelector("svg").getBoundingClientRect().height,
  texts: [...figure.querySelectorAll("text")].map((text) => text.textContent.trim()),
}));
const chip = at("#runs .run b");
found.chip = getComputedStyle(chip).backgroundColor;
found.stroke_is_chip = strokes(at("#curves figure")).has(found.chip);
const card = () => getComputedStyle(document.documentElement).getPropertyValue("--card").trim();
found.card = card();
dispatchEvent(new Event("beforeprint"));
found.printed = card();
dispatchEvent(new Event("afterprint"));
found.after = card();
setTimeout(() => {
  found.wide = document.documentElement.scrollWidth - innerWidth;
  const result = document.createElement("pre");
  result.id = "found";
  result.textContent = JSON.stringify(found);
  document.body.append(result);
}, 100);
