"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const AXES = ["x", "y", "z"], RIGID = "#7387a3", FLOWING = "#ed8029", SECONDS = 8; // of the whole film, played
const FOV = Math.PI / 4; // plotly's angle of view, upright
const GLYPH = 0.585; // size that plotly wants of a marker over the diameter that it then has [pixels]
const COVER = 1.24; // of a drawn particle over its own, so that the body is closed, as in the pictures
const TOP = 46; // [pixels], for the bar of colours
const element = (id) => document.getElementById(id);
const still = { displayModeBar: false, responsive: true };
const film = data.film, view = element("view");

function bytes(base64) {
  const text = atob(base64), found = new Uint8Array(text.length);
  for (let k = 0; k < text.length; k++) found[k] = text.charCodeAt(k);
  return found;
}

// ---- the body -----------------------------------------------------------------------------------------------------
if (film) {
  film.codes = new Uint16Array(bytes(film.positions).buffer);
  film.shades = bytes(film.colours);
  film.first = [0];
  film.counts.forEach((count, k) => film.first.push(film.first[k] + count));
}
const state = { output: 0, playing: false, drawing: null, size: 0 };

/* Positions [m] and colours of the particles at an output that the cut leaves. */
function particles(output) {
  const cut = element("cut").value, axis = AXES.indexOf(cut), limit = cut ? place() : 0, coded = element("colour").value;
  const found = { x: [], y: [], z: [], colour: [] };
  for (let i = film.first[output]; i < film.first[output + 1]; i++) {
    const at = AXES.map((_, k) => film.low[k] + film.step[k] * film.codes[3 * i + k]);
    if (cut && (cut === "y" ? at[axis] < limit : at[axis] > limit)) continue; // what is on the side of the reader
    AXES.forEach((name, k) => found[name].push(at[k]));
    const shade = film.shades[i];
    found.colour.push(coded === "speed" ? ((shade & 127) / 127) * film.fastest : shade >> 7);
  }
  return found;
}

function place() {
  const axis = AXES.indexOf(element("cut").value);
  return data.low[axis] + (data.high[axis] - data.low[axis]) * (element("place").value / 100);
}

function colouring() {
  const bar = { orientation: "h", x: 0.5, y: 1, yanchor: "bottom", thickness: 10, len: 0.6, outlinewidth: 0 };
  if (element("colour").value === "speed")
    return { colorscale: "Viridis", cmin: 0, cmax: film.fastest, colorbar: { ...bar, title: { text: "speed [m/s]", side: "top" } } };
  const words = { title: { text: "state of the concrete", side: "top" }, tickvals: [0.25, 0.75], ticktext: ["not flowing", "flowing"], ticks: "" };
  return { colorscale: [[0, RIGID], [0.5, RIGID], [0.5, FLOWING], [1, FLOWING]], cmin: 0, cmax: 1, colorbar: { ...bar, ...words } };
}

/* Diameter of a drawn particle in pixels, in the middle of the view. */
function diameter() {
  const { x, y, z } = view.layout.scene.camera.eye;
  const metre = (view.clientHeight - TOP) / 2 / Math.tan(FOV / 2) / Math.hypot(x, y, z) / data.unit;
  return Math.max(1.5, GLYPH * COVER * data.size * metre);
}

async function draw() {
  if (state.drawing) return state.drawing; // what is wanted by then is drawn in its turn
  state.drawing = (async () => {
    let drawn;
    do {
      drawn = state.output;
      const p = particles(drawn);
      await Plotly.restyle(view, { x: [p.x], y: [p.y], z: [p.z], "marker.color": [p.colour] }, [0]);
    } while (drawn !== state.output);
    state.drawing = null;
  })();
  return state.drawing;
}

function show(output) {
  state.output = output;
  element("time").value = output;
  element("now").textContent = `t = ${film.times[output].toFixed(2)} s`;
  return draw();
}

async function play() {
  state.playing = !state.playing;
  element("play").textContent = state.playing ? "Pause" : "Play";
  const last = film.times.length - 1, pause = Math.min(400, (1000 * SECONDS) / (last + 1));
  if (state.playing && state.output >= last) await show(0);
  while (state.playing && state.output < last) {
    const begun = performance.now();
    await new Promise((done) => setTimeout(done, pause));
    if (!state.playing) return;
    const passed = Math.max(1, Math.round((performance.now() - begun) / pause));
    await show(Math.min(last, state.output + passed));
  }
  state.playing = false;
  element("play").textContent = "Play";
}

async function recut() {
  const cut = element("cut").value;
  element("place").disabled = !cut;
  element("where").textContent = cut ? `${cut} = ${(Math.round(1000 * place()) / 10 + 0).toFixed(1)} cm` : "";
  if (state.drawing) await state.drawing;
  return draw();
}

async function recolour() {
  const { colorscale, cmin, cmax, colorbar } = colouring();
  const colour = particles(state.output).colour;
  const marker = { "marker.color": [colour], "marker.colorscale": [colorscale], "marker.cmin": cmin, "marker.cmax": cmax };
  return Plotly.restyle(view, { ...marker, "marker.colorbar": colorbar }, [0]);
}

async function resize() {
  const wanted = diameter();
  if (Math.abs(wanted / state.size - 1) < 0.02) return;
  state.size = wanted;
  return Plotly.restyle(view, { "marker.size": wanted }, [0]);
}

function zoom(factor) {
  const { x, y, z } = view.layout.scene.camera.eye;
  return Plotly.relayout(view, { "scene.camera.eye": { x: factor * x, y: factor * y, z: factor * z } }).then(resize);
}

/* Where the eye is, so that the whole box is seen: in front, a little to the right and above; of a plane in front. */
function eye() {
  const ratio = AXES.map((_, k) => (data.high[k] - data.low[k]) / data.unit);
  const wide = view.clientWidth / (view.clientHeight - TOP), tangent = 2 * Math.tan(FOV / 2);
  const across = (1.3 * ratio[0] + 0.4 * ratio[1]) / (tangent * wide), up = (1.2 * ratio[2] + 0.35 * ratio[1]) / tangent;
  const away = 0.4 * ratio[1] + Math.max(across, up);
  const towards = data.dimension === 2 ? [0, -1, 0] : [0.36, -0.86, 0.36];
  return { x: away * towards[0], y: away * towards[1], z: away * towards[2] };
}

function lines(points, colour) {
  const [x, y, z] = points;
  return { type: "scatter3d", mode: "lines", x, y, z, line: { color: colour, width: 2 }, hoverinfo: "skip" };
}

function floor() {
  const [a, b] = [data.low, data.high], z = data.floor;
  const corners = { x: [a[0], b[0], b[0], a[0]], y: [a[1], a[1], b[1], b[1]], z: [z, z, z, z], i: [0, 0], j: [1, 2], k: [2, 3] };
  return { type: "mesh3d", ...corners, color: "#eceeef", hoverinfo: "skip", lighting: { ambient: 1, diffuse: 0 } };
}

async function begin() {
  const axis = (k) => ({
    title: { text: `${AXES[k]} [m]` }, range: [data.low[k], data.high[k]], nticks: 5, showspikes: false,
    showbackground: false, gridcolor: "#e3e6e9", zeroline: false, visible: !(data.dimension === 2 && k === 1),
  });
  const ratio = AXES.map((_, k) => (data.high[k] - data.low[k]) / data.unit);
  const layout = {
    margin: { l: 0, r: 0, t: TOP, b: 0 }, showlegend: false,
    scene: {
      xaxis: axis(0), yaxis: axis(1), zaxis: axis(2), dragmode: "turntable",
      aspectmode: "manual", aspectratio: { x: ratio[0], y: ratio[1], z: ratio[2] }, camera: { eye: eye(), center: { x: 0, y: 0, z: -0.08 }, up: { x: 0, y: 0, z: 1 } },
    },
  };
  view.layout = layout;
  state.size = diameter();
  const p = particles(0), edge = { width: 1, color: "#4a4f57" };
  const marker = { size: state.size, color: p.colour, line: edge, opacity: 1, ...colouring() };
  const body = { type: "scatter3d", mode: "markers", x: p.x, y: p.y, z: p.z, marker, hoverinfo: "skip" };
  const traces = [body, lines(data.walls, "#70767e"), lines(data.outline, "#c43e26")];
  if (data.floor !== null) traces.push(floor());
  await Plotly.newPlot(view, traces, layout, { ...still, scrollZoom: false });
  view.on("plotly_relayout", resize);
  element("time").max = film.times.length - 1;
  element("time").oninput = () => show(Number(element("time").value));
  element("play").onclick = play;
  element("colour").onchange = recolour;
  element("cut").onchange = element("place").oninput = recut;
  element("nearer").onclick = () => zoom(0.8);
  element("farther").onclick = () => zoom(1.25);
  await show(film.times.length - 1); // what it has come to; played from the start
}

// ---- curves and section -------------------------------------------------------------------------------------------
function plane(x, y) {
  const axis = { zeroline: false, gridcolor: "#e3e6e9", linecolor: "#70767e", showline: true, fixedrange: true };
  return {
    margin: { l: 55, r: 12, t: 10, b: 45 }, legend: { orientation: "h", y: 1.02, yanchor: "bottom" }, dragmode: false,
    xaxis: { ...axis, title: { text: x } }, yaxis: { ...axis, title: { text: y } }, showlegend: true,
  };
}

function chart({ unit, curves, along = "time [s]", title }, place) {
  const usual = curves.length > 1 ? `[${unit}]` : `${curves[0].name} [${unit}]`;
  const at = along.match(/\[(.*)\]/)[1];
  const traces = curves.map(({ name, x, y }) => ({ name, x, y, mode: "lines", hovertemplate: `%{y} ${unit} at %{x} ${at}` }));
  const layout = plane(along, title ?? (unit ? usual : curves[0].name));
  layout.yaxis.rangemode = "tozero";
  return Plotly.newPlot(place, traces, { ...layout, showlegend: curves.length > 1 }, still);
}

function cross(section) {
  const cm = (values) => values.map((value) => (value === null ? null : 100 * value));
  const shape = { fill: "toself", fillcolor: "#adacaa", line: { color: "#70767e", width: 0.5 }, hoverinfo: "skip" };
  const top = { line: { color: "#c43e26", width: 2 }, hovertemplate: "%{y:.1f} cm high at %{x:.1f} cm" };
  const traces = [
    { name: "particles", mode: "lines", x: cm(section.across), y: cm(section.up), ...shape },
    { name: "surface", mode: "lines", x: cm(section.surface[0]), y: cm(section.surface[1]), ...top },
  ];
  const layout = plane("across [cm]", "height [cm]");
  layout.yaxis.scaleanchor = "x";
  layout.yaxis.constrain = layout.xaxis.constrain = "domain";
  const known = section.across.filter((value) => value !== null), up = section.up.filter((value) => value !== null);
  const span = (values) => values.reduce((a, b) => Math.max(a, b)) - values.reduce((a, b) => Math.min(a, b));
  const place = element("section");
  const tall = ((place.clientWidth - 70) * span(up)) / span(known);
  place.style.height = `${Math.round(Math.min(480, Math.max(120, tall)) + 90)}px`;
  element("plane").textContent = `Equal scales. ${section.place[0].toUpperCase()}${section.place.slice(1)}.`;
  return Plotly.newPlot(place, traces, layout, still);
}

async function write() {
  const places = data.charts.map(() => element("charts").appendChild(document.createElement("div")));
  places.forEach((place) => (place.className = "chart")); // all of them, before the first one takes its width
  for (let k = 0; k < places.length; k++) await chart(data.charts[k], places[k]);
  if (!film) return;
  element("body").hidden = element("cross").hidden = false;
  await cross(data.section);
  await begin();
}
const ready = write();
