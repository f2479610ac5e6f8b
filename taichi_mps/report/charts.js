"use strict";
/* Curves as SVG, which are sharp in print; a pointer reads them. */
const COLOURS = ["#1f6fb5", "#d1662a", "#2e8b57", "#8f4f9f", "#b8323f", "#7a6a35"];
const FILLED = [[184, 50, 63], [240, 201, 168], [154, 161, 169]]; // nothing, half, all
const element = (id) => document.getElementById(id);

function svg(name, attributes = {}, text) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  return made;
}

/* Round numbers from low to high, about ``count`` of them. */
function ticks(low, high, count) {
  const raw = (high - low) / count || 1, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((k) => k * power).find((value) => value >= 0.99 * raw), found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(Number((k * step).toPrecision(12)));
  return found;
}

/* A frame for curves between low and high of x and y: the drawing, and the functions of its places. */
function frame(wide, tall, [x0, x1], [y0, y1], across, upwards) {
  const [left, right, top, bottom] = [46, 10, 24, 36], drawing = svg("svg", { viewBox: `0 0 ${wide} ${tall}`, role: "img", "aria-label": `${upwards} against ${across}` });
  const x = (value) => left + ((value - x0) / (x1 - x0 || 1)) * (wide - left - right);
  const y = (value) => tall - bottom - ((value - y0) / (y1 - y0 || 1)) * (tall - top - bottom);
  for (const value of ticks(y0, y1, tall / 45)) {
    drawing.append(svg("line", { x1: left, x2: wide - right, y1: y(value), y2: y(value), class: "grid" }));
    drawing.append(svg("text", { x: left - 6, y: y(value) + 4, "text-anchor": "end" }, value));
  }
  for (const value of ticks(x0, x1, wide / 70)) {
    drawing.append(svg("line", { x1: x(value), x2: x(value), y1: tall - bottom, y2: tall - bottom + 4, class: "axis" }));
    drawing.append(svg("text", { x: x(value), y: tall - bottom + 17, "text-anchor": "middle" }, value));
  }
  drawing.append(svg("line", { x1: left, x2: wide - right, y1: tall - bottom, y2: tall - bottom, class: "axis" }));
  drawing.append(svg("text", { x: wide - right, y: tall - 3, "text-anchor": "end" }, across));
  drawing.append(svg("text", { x: 2, y: 12, class: "name" }, upwards));
  return { drawing, x, y };
}

function path(xs, ys, x, y) {
  let pen = "M", text = "";
  xs.forEach((value, k) => {
    if (value === null || ys[k] === null) pen = "M";
    else { text += `${pen}${x(value).toFixed(1)} ${y(ys[k]).toFixed(1)}`; pen = "L"; }
  });
  return text;
}

const span = (rows) => rows.flat().reduce(([a, b], v) => (v === null ? [a, b] : [Math.min(a, v), Math.max(b, v)]), [Infinity, -Infinity]);

/* Curves of one unit; what the pointer is at stands below, clear of the curves. */
function chart({ unit, curves, along = "time [s]", title, legend = true }, place) {
  const name = title ?? (curves.length > 1 ? `[${unit}]` : `${curves[0].name}${unit ? ` [${unit}]` : ""}`);
  const [low, high] = span(curves.map((c) => c.y)), [x0, x1] = span(curves.map((c) => c.x));
  const { drawing, x, y } = frame(440, 230, [x0, x1], [Math.min(0, low), 1.03 * high || 1], along, name);
  let from = 12 + 7.2 * name.length;
  curves.forEach((curve, k) => {
    const colour = COLOURS[k % COLOURS.length];
    drawing.append(svg("path", { d: path(curve.x, curve.y, x, y), fill: "none", stroke: colour, "stroke-width": 2 }));
    if (curves.length < 2 || !legend) return;
    drawing.append(svg("line", { x1: from, x2: from + 14, y1: 8, y2: 8, stroke: colour, "stroke-width": 3 }));
    drawing.append(svg("text", { x: from + 18, y: 12 }, curve.name));
    from += 30 + 6.4 * curve.name.length;
  });
  const mark = svg("line", { y1: 20, y2: 194, class: "mark" }), read = svg("text", { x: 2, y: 227, class: "read" });
  drawing.append(mark, read);
  drawing.onpointermove = (event) => {
    const box = drawing.getBoundingClientRect(), at = ((event.clientX - box.left) / box.width) * 440;
    const wanted = x0 + ((at - 46) / (440 - 56)) * (x1 - x0);
    const nearest = (xs) => xs.reduce((best, value, i) => (Math.abs(value - wanted) < Math.abs(xs[best] - wanted) ? i : best), 0);
    const there = curves.map((c) => c.x[nearest(c.x)]), now = there[nearest(there)], px = x(now); // one may end before another
    mark.setAttribute("x1", px); mark.setAttribute("x2", px);
    const digits = (value) => (value === null ? "-" : Number(value.toPrecision(3)));
    read.textContent = `${digits(now)}: ${curves.map((c) => digits(c.y[nearest(c.x)])).join(", ")} ${unit}`.trimEnd();
    drawing.classList.add("reading");
  };
  drawing.onpointerleave = () => drawing.classList.remove("reading");
  place.append(drawing);
}

/* Rows of cells as a CSV file that is downloaded. */
function save(name, rows) {
  const quoted = (cell) => (/[",\n]/.test(cell) ? `"${String(cell).replaceAll('"', '""')}"` : cell);
  const text = rows.map((row) => `${row.map(quoted).join(",")}\n`).join(""), link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type: "text/csv" }));
  link.download = `${name}.csv`;
  link.click();
}

/* Rows of a CSV file from charts: the time once, then each curve; of another abscissa each with its own. */
function columns(charts) {
  const found = charts.flatMap(({ unit, curves, along, title }, k) =>
    curves.flatMap((c, i) => [...(along || k + i === 0 ? [[along ?? "time [s]", ...c.x]] : []), [along ? `${c.name}: ${title}` : `${c.name}${unit ? ` [${unit}]` : ""}`, ...c.y]]));
  return Array.from({ length: Math.max(...found.map((column) => column.length)) }, (_, row) => found.map((column) => column[row] ?? ""));
}

/* Cells of a table of results: name, number, unit, expected error [mm], what it is. */
function results(rows) {
  const split = (value) => /^(-?[\d.]+(?:e[-+]?\d+)?) ?([^±]*?)(?: ± (\d+) mm)?$/.exec(value)?.slice(1) ?? [value, "", ""];
  return [["result", "value", "unit", "expected error [mm]", "what it is"], ...rows.map(([name, value, what]) => [name, ...split(value).map((cell) => cell ?? ""), what])];
}

/* A frame of equal scales. */
function scaled(place, [x0, x1], [low, high], axes) {
  const wide = Math.min(760, Math.max(340, place.clientWidth)), tall = Math.max(110, Math.min(420, ((wide - 56) * (high - low)) / (x1 - x0))) + 60;
  const spare = (((tall - 60) / (high - low)) * (x1 - x0)) / (wide - 56), more = Math.max(0, ((1 / spare - 1) * (x1 - x0)) / 2);
  return frame(wide, tall, [x0 - more, x1 + more], [low, high], ...axes);
}

const cm = (values) => values.map((value) => (value === null ? null : 100 * value));

/* Closed lines [x, z] in which a mesh meets the plane y = middle, none of them below the floor. */
function sliced({ at, triangles }, middle, floor) {
  const ends = new Map(), places = new Map(), y = (i) => at[3 * i + 1] - middle || 1e-9;
  for (let k = 0; k < triangles.length; k += 3) {
    const keys = [0, 1, 2].flatMap((c) => {
      const [i, j] = [triangles[k + c], triangles[k + ((c + 1) % 3)]].sort((a, b) => a - b), part = y(i) / (y(i) - y(j));
      if (y(i) > 0 === y(j) > 0) return [];
      places.set(`${i} ${j}`, [0, 2].map((d) => at[3 * i + d] + part * (at[3 * j + d] - at[3 * i + d])));
      return [`${i} ${j}`];
    });
    keys.forEach((key, c) => ends.set(key, [...(ends.get(key) ?? []), keys[1 - c]]));
  }
  const lines = [], left = new Set([...places.keys()].sort((a, b) => ends.get(a).length - ends.get(b).length)); // loose ends first
  for (let key of left) {
    const line = [];
    for (; key; key = ends.get(key).find((other) => left.has(other))) {
      const [x, z] = places.get(key);
      line.push([x, Math.max(z, floor ?? z)]);
      left.delete(key);
    }
    lines.push(line);
  }
  return lines;
}

/* The section at the end: of a body the lines of its surface, of a plane one its particles. */
function cross(section, lines, place) {
  const [across, up] = lines ? [0, 1].map((k) => lines.flatMap((line) => [...line, line[0], [null, null]].map((at) => at[k] && 100 * at[k]))) : [cm(section.across), cm(section.up)];
  const { drawing, x, y } = scaled(place, span([across]), [Math.min(0, span([up])[0]), span([up])[1]], section.axes);
  drawing.append(svg("path", { d: path(across, up, x, y), class: lines ? "body" : "particles" }));
  place.append(drawing);
  element("plane").textContent = `Equal scales. ${section.place[0].toUpperCase()}${section.place.slice(1)}.`;
}

/* What of a form is filled, from red (empty) to grey. */
function filled({ low, high, rows }, place) {
  const picture = document.createElement("canvas"), [wide, tall] = [rows[0].length, rows.length];
  [picture.width, picture.height] = [wide, tall];
  const pen = picture.getContext("2d"), image = pen.createImageData(wide, tall), [[left, bottom], [right, top]] = [cm(low), cm(high)];
  rows.forEach((row, k) => row.forEach((fraction, i) => {
    const [a, b, part] = fraction < 0.5 ? [FILLED[0], FILLED[1], 2 * fraction] : [FILLED[1], FILLED[2], 2 * fraction - 1];
    if (fraction !== null) image.data.set([...a.map((value, c) => value + part * (b[c] - value)), 255], 4 * ((tall - 1 - k) * wide + i));
  }));
  pen.putImageData(image, 0, 0);
  const { drawing, x, y } = scaled(place, [left, right], [bottom, top], ["along the form [cm]", "height [cm]"]);
  drawing.append(svg("image", { x: x(left), y: y(top), width: x(right) - x(left), height: y(bottom) - y(top), href: picture.toDataURL(), preserveAspectRatio: "none", style: "image-rendering: pixelated" }));
  place.append(drawing);
  element("plane").textContent += " Below: what is filled through the thickness; grey: all, red: nothing.";
}
