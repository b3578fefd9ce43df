// Tables sort by a click on their heads, pictures grow, paper is light. Without this script the page says the same.
(() => {
  "use strict";

  addEventListener("beforeprint", () => document.documentElement.classList.add("printing"));
  addEventListener("afterprint", () => document.documentElement.classList.remove("printing"));

  function value(row, column) {
    const cell = row.cells[column], text = cell.dataset.value ?? cell.textContent.trim();
    const number = parseFloat(text.replace(/[\u202f\s]/g, "").replace("−", "-"));
    return [text, Number.isNaN(number) ? null : number];
  }

  function sort(table, head, column) {
    const numeric = head.classList.contains("n");
    const was = head.getAttribute("aria-sort");
    const down = was ? was === "ascending" : numeric; // the largest number first, but words from a
    const rows = [...table.tBodies[0].rows].map((row) => ({ row, key: value(row, column) }));
    rows.sort(({ key: [a, x] }, { key: [b, y] }) => {
      if (!numeric) return (down ? -1 : 1) * a.localeCompare(b, undefined, { numeric: true });
      if (x === null || y === null) return (x === null) - (y === null); // what is not known stays below
      return down ? y - x : x - y;
    });
    table.tBodies[0].append(...rows.map(({ row }) => row));
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
  }

  for (const table of document.querySelectorAll("table.sortable")) {
    [...table.tHead.rows[0].cells].forEach((head, column) => {
      if (!head.textContent.trim()) return;
      const button = document.createElement("button");
      button.type = "button";
      button.append(...head.childNodes);
      button.onclick = () => sort(table, head, column);
      head.append(button);
    });
  }

  // One stop of the tab key for each group of pictures; within it the arrow keys go on.
  const dialog = document.createElement("dialog");
  const large = document.createElement("img"), words = document.createElement("p"), close = document.createElement("button");
  close.type = "button";
  close.textContent = "Close";
  dialog.className = "large";
  dialog.append(large, words, close);
  document.body.append(dialog);
  let group = [], shown = 0;

  function show(index) {
    shown = (index + group.length) % group.length;
    const picture = group[shown];
    large.src = picture.src;
    large.alt = picture.alt;
    large.classList.toggle("pixels", picture.naturalWidth < 100);
    words.textContent = `${picture.alt}: ${picture.nextElementSibling.textContent}`;
    dialog.setAttribute("aria-label", words.textContent);
  }

  const step = (event) => ({ ArrowRight: 1, ArrowLeft: -1 })[event.key] ?? 0;
  dialog.addEventListener("keydown", (event) => {
    if (step(event)) show(shown + step(event));
  });
  dialog.addEventListener("click", (event) => { if (event.target !== words) dialog.close(); });
  dialog.addEventListener("close", () => focus(group, shown));

  function focus(pictures, index) {
    const at = (index + pictures.length) % pictures.length;
    pictures.forEach((picture, i) => { picture.tabIndex = i === at ? 0 : -1; });
    pictures[at].focus();
  }

  for (const section of document.querySelectorAll(".shapes")) {
    const pictures = [...section.querySelectorAll(".views img")];
    pictures.forEach((picture, index) => {
      const open = () => {
        group = pictures;
        show(index);
        dialog.showModal();
      };
      picture.tabIndex = index ? -1 : 0;
      picture.setAttribute("role", "button");
      picture.onclick = open;
      picture.onkeydown = (event) => {
        if (event.key === "Enter" || event.key === " ") {
          event.preventDefault();
          open();
        } else if (step(event)) {
          event.preventDefault();
          focus(pictures, index + step(event));
        }
      };
    });
  }
})();
