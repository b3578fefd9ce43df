// The shape and its cameras as pyramids, on a plain canvas. Angles as in docs/cameras.md.
(() => {
  "use strict";
  const box = document.getElementById("viewer");
  if (!box) return;
  const data = JSON.parse(document.getElementById("viewer-data").textContent), shapes = data.shapes;
  const canvas = box.querySelector("canvas"), pen = canvas.getContext("2d");
  const choice = box.querySelector("select"), chips = box.querySelector(".chips");
  const started = box.querySelector("input"), said = box.querySelector("output");
  const HOME = { azimuth: 28, elevation: 20, zoom: 1 }, FARTHEST = 4, DISC = 0.045, SHADES = 128, LIGHT = [-0.31, 0.55, 0.775], CREASE = 0.8;
  const state = { ...HOME, shape: 0, through: null };
  const radians = (degrees) => degrees * Math.PI / 180;
  const dot = (p, q) => p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
  const sum = (...terms) => [0, 1, 2].map((i) => terms.reduce((t, [s, p]) => t + s * p[i], 0));
  const turn = (degrees) => ((degrees + 180) % 360 + 360) % 360 - 180;
  const degrees = (angle) => `${Math.round(angle)}°`.replace("-", "−").replace("−0°", "0°");

  function bytes(text) {
    return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
  }
  const fractions = (text) => {
    const view = new DataView(bytes(text));
    return Float32Array.from({ length: view.byteLength / 2 }, (_, i) => view.getInt16(2 * i, true) / 32767);
  };
  const triples = (numbers) => Array.from({ length: numbers.length / 3 }, (_, i) => [...numbers.slice(3 * i, 3 * i + 3)]);
  const unpacked = new Map();

  function solid(shape) {
    if (!unpacked.has(shape)) {
      unpacked.set(shape, shape.faces
        ? mesh(triples(fractions(shape.vertices)), triples(new Uint16Array(bytes(shape.faces))))
        : { points: triples(fractions(shape.points)), normals: triples(Array.from(new Int8Array(bytes(shape.normals)), (n) => n / 127)) });
    }
    return unpacked.get(shape);
  }

  // Each corner of a face has the mean normal of the faces that meet it there without a crease.
  function mesh(vertices, faces) {
    const cross = (p, q) => [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
    const normals = faces.map(([a, b, c]) => cross(sum([1, vertices[b]], [-1, vertices[a]]), sum([1, vertices[c]], [-1, vertices[a]])));
    const sizes = normals.map((normal) => Math.hypot(...normal) || 1);
    const around = vertices.map(() => []);
    faces.forEach((face, f) => face.forEach((vertex) => around[vertex].push(f)));
    const corners = faces.map((face, f) => face.map((vertex) => {
      const together = [];
      for (const g of around[vertex]) {
        const cosine = dot(normals[f], normals[g]) / sizes[f] / sizes[g];
        if (Math.abs(cosine) > CREASE) together.push([Math.sign(cosine), normals[g]]);
      }
      const mean = sum(...together), length = Math.hypot(...mean) || 1;
      return mean.map((part) => part / length);
    }));
    return { vertices, faces, corners };
  }

  // right, up and backward of a camera
  function axes(azimuth, elevation) {
    const a = radians(azimuth), e = radians(elevation);
    const [sa, ca, se, ce] = [Math.sin(a), Math.cos(a), Math.sin(e), Math.cos(e)];
    return [[ca, 0, -sa], [-se * sa, ce, -se * ca], [ce * sa, se, ce * ca]];
  }

  function palette() {
    const style = getComputedStyle(document.documentElement);
    const name = (word) => style.getPropertyValue(word).trim();
    const rgb = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));
    const [card, ink] = [rgb(name("--card")), rgb(name("--ink"))];
    const shades = Array.from({ length: SHADES }, (_, i) =>
      card.map((c, j) => Math.round(c + (ink[j] - c) * i / (SHADES - 1))));
    return {
      shades, dark: dot(card, [1, 1, 1]) < dot(ink, [1, 1, 1]), ink: name("--ink"),
      muted: name("--muted"), line: name("--line"),
      views: data.colors.map((color) => color.startsWith("--") ? name(color) : color),
    };
  }

  const near = (camera) => [camera[0], camera[1], Math.min(camera[2], FARTHEST)];

  function onlooker(shape, width, height) {
    const half = Math.min(width, height) / 2;
    if (state.through !== null) {
      const [azimuth, elevation, distance] = shape.cameras[state.through];
      return { basis: axes(azimuth, elevation), distance, focal: 0.96 * half / Math.tan(radians(data.fov / 2)) };
    }
    const reach = Math.max(...shape.cameras.map((camera) => near(camera)[2])) + 0.3, distance = 3.2 * reach;
    const focal = state.zoom * half / Math.tan(Math.asin(reach / distance));
    return { basis: axes(state.azimuth, state.elevation), distance, focal };
  }

  function draw() {
    const shape = shapes[state.shape], colors = palette();
    const width = canvas.clientWidth, height = canvas.clientHeight, ratio = window.devicePixelRatio || 1;
    if (!width) return;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.lineJoin = "round";
    pen.font = "11px system-ui, sans-serif";
    const { basis: [right, up, backward], distance, focal } = onlooker(shape, width, height);
    const project = (p) => {
      const depth = distance - dot(backward, p);
      return [width / 2 + focal * dot(right, p) / depth, height / 2 - focal * dot(up, p) / depth, depth];
    };
    const items = [];
    const eye = { right, up, backward, distance, focal, width, height, ratio };
    const light = shade(eye, colors);
    const { points, normals, faces } = solid(shape);
    if (faces) {
      items.push({ depth: distance, paint: () => drawMesh(solid(shape), eye, light, colors) });
    } else {
      points.forEach((at, i) => {
        const [x, y, depth] = project(at), facing = dot(normals[i], backward), side = facing < 0 ? -1 : 1;
        const angle = Math.atan2(-side * dot(normals[i], up), side * dot(normals[i], right));
        const color = `rgb(${colors.shades[light(normals[i], depth)].join(" ")})`;
        items.push({ depth, paint: () => disc(x, y, DISC * focal / depth, Math.abs(facing), angle, color) });
      });
    }
    if (state.through === null) {
      drawRing(shape, project, colors);
      shape.cameras.forEach((camera, view) => {
        const depth = project(sum([near(camera)[2] - 0.2, axes(...camera)[2]]))[2];
        items.push({ depth, paint: () => pyramid(near(camera), project, colors.views[view], 1) });
        if (started && started.checked && shape.start) {
          const before = shape.start[view];
          items.push({ depth: depth + 1e-6, paint: () => {
            path(near(before), near(camera), project, colors.views[view]);
            pyramid(near(before), project, colors.views[view], 0.45);
          } });
        }
      });
    }
    items.sort((one, other) => other.depth - one.depth).forEach((item) => item.paint());
    if (state.through === null) drawNumbers(shape, project, colors);
    else frame(width, height, colors.views[state.through]);
    tell(shape);
  }

  // Which of the shades: normals have no sign, so that each is that of the side which is seen.
  function shade({ right, up, backward, distance }, colors) {
    return (normal, depth) => {
      const facing = dot(normal, backward), side = facing < 0 ? -1 : 1;
      const lit = side * (LIGHT[0] * dot(normal, right) + LIGHT[1] * dot(normal, up)) + LIGHT[2] * Math.abs(facing);
      const far = Math.min(1, Math.max(0, (depth - distance + 1) / 2));
      const strength = colors.dark ? 0.25 + 0.65 * Math.max(0, lit) : 0.78 - 0.62 * Math.max(0, lit);
      return Math.round(strength * (1 - 0.25 * far) * (SHADES - 1));
    };
  }

  // Triangles with a depth for each pixel, in a layer of their own that is as large as the unit ball.
  function drawMesh({ vertices, faces, corners }, eye, light, colors) {
    const { right, up, backward, distance, focal, width, height, ratio } = eye;
    const finer = ratio < 2 ? 2 * ratio : ratio, reach = 1.05 * focal / Math.sqrt(distance * distance - 1);
    const left = Math.max(0, width / 2 - reach), top = Math.max(0, height / 2 - reach);
    const wide = Math.ceil((width - 2 * left) * finer), high = Math.ceil((height - 2 * top) * finer);
    const layer = new ImageData(wide, high), nearest = new Float32Array(wide * high), pixels = layer.data;
    const seen = vertices.map((p) => {
      const depth = distance - dot(backward, p);
      return [
        (width / 2 + focal * dot(right, p) / depth - left) * finer,
        (height / 2 - focal * dot(up, p) / depth - top) * finer, 1 / depth,
      ];
    });
    faces.forEach((face, f) => {
      const [a, b, c] = face.map((vertex) => seen[vertex]);
      const area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
      if (!area) return;
      const tones = face.map((vertex, i) => light(corners[f][i], 1 / seen[vertex][2]));
      const x0 = Math.max(0, Math.ceil(Math.min(a[0], b[0], c[0]))), x1 = Math.min(wide - 1, Math.floor(Math.max(a[0], b[0], c[0])));
      const y0 = Math.max(0, Math.ceil(Math.min(a[1], b[1], c[1]))), y1 = Math.min(high - 1, Math.floor(Math.max(a[1], b[1], c[1])));
      for (let y = y0; y <= y1; y++) {
        for (let x = x0; x <= x1; x++) {
          const v = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / area;
          const w = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area, u = 1 - v - w;
          if (u < 0 || v < 0 || w < 0) continue;
          const at = y * wide + x, close = u * a[2] + v * b[2] + w * c[2];
          if (close <= nearest[at]) continue;
          nearest[at] = close;
          const color = colors.shades[Math.round(u * tones[0] + v * tones[1] + w * tones[2])];
          pixels.set(color, 4 * at);
          pixels[4 * at + 3] = 255;
        }
      }
    });
    const sheet = document.createElement("canvas");
    sheet.width = wide;
    sheet.height = high;
    sheet.getContext("2d").putImageData(layer, 0, 0);
    pen.drawImage(sheet, left, top, wide / finer, high / finer);
  }

  // A round piece of surface, seen at a slant.
  function disc(x, y, radius, facing, angle, color) {
    pen.fillStyle = color;
    pen.beginPath();
    pen.ellipse(x, y, Math.max(0.8, radius * facing), Math.max(0.8, radius), angle, 0, 2 * Math.PI);
    pen.fill();
  }

  function lines(corners, close) {
    pen.beginPath();
    corners.forEach(([x, y], i) => i ? pen.lineTo(x, y) : pen.moveTo(x, y));
    if (close) pen.closePath();
  }

  // What a camera sees begins at its tip; the small roof is where its picture's top is.
  function pyramid([azimuth, elevation, distance], project, color, strength) {
    const [right, up, backward] = axes(azimuth, elevation);
    const long = 0.34, wide = Math.min(0.3, long * Math.tan(radians(data.fov / 2)));
    const base = (x, y) => project(sum([distance - long, backward], [x * wide, right], [y * wide, up]));
    const tip = project(sum([distance, backward]));
    const corners = [base(-1, -1), base(1, -1), base(1, 1), base(-1, 1)];
    pen.strokeStyle = pen.fillStyle = color;
    pen.lineWidth = 1.4;
    pen.globalAlpha = 0.16 * strength;
    lines(corners, true);
    pen.fill();
    pen.globalAlpha = strength;
    pen.stroke();
    for (const corner of corners) {
      lines([tip, corner]);
      pen.stroke();
    }
    lines([base(-0.5, 1), base(0, 1.5), base(0.5, 1)], true);
    pen.fill();
    pen.globalAlpha = 1;
  }

  // Over everything, so that they can be read also where a camera stands behind the shape.
  function drawNumbers(shape, project, colors) {
    pen.font = "600 12px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    pen.lineWidth = 3;
    pen.strokeStyle = `rgb(${colors.shades[0].join(" ")})`;
    shape.cameras.forEach((camera, view) => {
      const [x, y] = project(sum([near(camera)[2] + 0.13, axes(...camera)[2]]));
      pen.strokeText(String(view + 1), x, y);
      pen.fillStyle = colors.views[view];
      pen.fillText(String(view + 1), x, y);
    });
  }

  function path(from, to, project, color) {
    const steps = Array.from({ length: 25 }, (_, i) => from.map((value, j) => value + (to[j] - value) * i / 24));
    pen.strokeStyle = color;
    pen.lineWidth = 1;
    pen.setLineDash([3, 3]);
    lines(steps.map(([azimuth, elevation, distance]) => project(sum([distance, axes(azimuth, elevation)[2]]))));
    pen.stroke();
    pen.setLineDash([]);
  }

  function drawRing(shape, project, colors) {
    const radius = Math.max(...shape.cameras.map((camera) => near(camera)[2]));
    const around = (azimuth, more) => project(sum([radius + more, axes(azimuth, 0)[2]]));
    pen.strokeStyle = colors.line;
    pen.fillStyle = colors.muted;
    pen.lineWidth = 1;
    lines(Array.from({ length: 72 }, (_, i) => around(5 * i, 0)), true);
    pen.stroke();
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    for (const azimuth of [-90, 0, 90, 180]) {
      lines([around(azimuth, -0.06), around(azimuth, 0.06)]);
      pen.stroke();
      const [x, y] = around(azimuth, 0.2);
      pen.fillText(degrees(azimuth), x, y);
    }
  }

  function frame(width, height, color) {
    const half = 0.96 * Math.min(width, height) / 2;
    pen.strokeStyle = color;
    pen.lineWidth = 1.5;
    pen.strokeRect(width / 2 - half, height / 2 - half, 2 * half, 2 * half);
  }

  function tell(shape) {
    const through = state.through;
    const [azimuth, elevation] = through === null ? [state.azimuth, state.elevation] : shape.cameras[through];
    const who = through === null ? "Seen from" : `Through camera ${through + 1}:`;
    said.textContent = `${who} azimuth ${degrees(turn(azimuth))}, elevation ${degrees(turn(elevation))}`;
    for (const chip of chips.children) chip.setAttribute("aria-pressed", String(Number(chip.textContent) === (through ?? -1) + 1));
  }

  function listCameras() {
    chips.replaceChildren(...shapes[state.shape].cameras.map((_, view) => {
      const chip = document.createElement("button");
      chip.type = "button";
      chip.textContent = String(view + 1);
      const color = data.colors[view];
      chip.style.setProperty("--c", color.startsWith("--") ? `var(${color})` : color);
      chip.setAttribute("aria-label", `Look through camera ${view + 1}`);
      chip.onclick = () => change({ through: state.through === view ? null : view });
      return chip;
    }));
    if (started) started.disabled = !shapes[state.shape].start;
  }

  function change(to) {
    Object.assign(state, to);
    state.azimuth = turn(state.azimuth);
    state.elevation = Math.min(90, Math.max(-90, state.elevation));
    state.zoom = Math.min(5, Math.max(0.5, state.zoom));
    draw();
  }

  // Turning away from a camera begins where that camera stands.
  function rotate(azimuth, elevation) {
    const from = state.through === null ? state : {
      azimuth: shapes[state.shape].cameras[state.through][0], elevation: shapes[state.shape].cameras[state.through][1],
    };
    change({ through: null, azimuth: from.azimuth + azimuth, elevation: from.elevation + elevation });
  }

  const zoom = (factor) => change({ through: null, zoom: state.zoom * factor });
  const reset = () => change({ ...HOME, through: null });
  const KEYS = {
    ArrowLeft: () => rotate(-5, 0), ArrowRight: () => rotate(5, 0), ArrowUp: () => rotate(0, 5),
    ArrowDown: () => rotate(0, -5), "+": () => zoom(1.2), "=": () => zoom(1.2), "-": () => zoom(1 / 1.2),
    Home: reset, r: reset,
  };
  canvas.addEventListener("keydown", (event) => {
    if (!(event.key in KEYS) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    KEYS[event.key]();
  });
  let held = null;
  canvas.addEventListener("pointerdown", (event) => {
    held = [event.clientX, event.clientY];
    try { canvas.setPointerCapture(event.pointerId); } catch { /* a pointer that is gone already */ }
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!held) return;
    rotate(-0.4 * (event.clientX - held[0]), 0.4 * (event.clientY - held[1]));
    held = [event.clientX, event.clientY];
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { held = null; });
  const DO = { in: () => zoom(1.25), out: () => zoom(0.8), reset };
  for (const button of box.querySelectorAll("[data-do]")) button.onclick = DO[button.dataset.do];
  choice.onchange = () => {
    change({ shape: Number(choice.value), through: null });
    listCameras();
    draw();
  };
  if (started) started.onchange = draw;
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  new ResizeObserver(draw).observe(canvas);
  addEventListener("beforeprint", draw); // page.js has made the page light
  addEventListener("afterprint", draw);
  choice.value = "0"; // a browser may remember another one
  listCameras();
  draw();
})();
