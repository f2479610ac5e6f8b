"use strict";
/* A slump cone to pull, from a table of runs. Lengths [m], times [s]; uses charts.js and viewer.js of the report. */
const table = JSON.parse(element("table").textContent), HEIGHT = 0.3, BASE = 0.1, TOP = 0.05, SECTORS = 72;
const [TAU, ETA] = [table.yield, table.viscosity], LIMITS = { yield: [TAU[0], TAU.at(-1)], viscosity: [ETA[0], ETA.at(-1)] };
const CLASSES = [ // of EN 206: name, what is read, from and to [mm], what its button pulls to [mm]
  ["S1", "highest", 10, 40, 25], ["S2", "highest", 50, 90, 70], ["S3", "highest", 100, 150, 125], ["S4", "highest", 160, 210, 185], ["S5", "highest", 220, Infinity, 235],
  ["SF1", "spread", 550, 650, 600], ["SF2", "spread", 660, 750, 700], ["SF3", "spread", 760, 850, 800]];
const CASES = [["#1", 100, 50], ["#2", 300, 50], ["#3", 500, 50], ["#5", 100, 1500]]; // of the paper; #4 is #1
const state = { yield: 300, viscosity: 50, time: Infinity, playing: 0, course: null, viewer: null, mesh: null, due: 0, asked: 0, rest: 0 };
const SLOW = 40; // [ms] from a change to its picture
const dark = matchMedia("(prefers-color-scheme: dark)");

// ---- between the mixes of the table -------------------------------------------------------------------------------
/* Weights {node: weight} of a cubic through the values at nodes, whose slopes are those from neighbour to neighbour. */
function weights(nodes, x) {
  const last = nodes.length - 1, k = Math.max(0, Math.min(last - 1, nodes.findLastIndex((node) => node <= x)));
  const h = nodes[k + 1] - nodes[k], s = (x - nodes[k]) / h, found = {};
  const add = (node, weight) => (found[node] = (found[node] ?? 0) + weight);
  add(k, (1 + 2 * s) * (1 - s) ** 2);
  add(k + 1, s * s * (3 - 2 * s));
  for (const [node, slope] of [[k, h * s * (1 - s) ** 2], [k + 1, h * s * s * (s - 1)]]) {
    const before = Math.max(0, node - 1), after = Math.min(last, node + 1);
    add(after, slope / (nodes[after] - nodes[before]));
    add(before, -slope / (nodes[after] - nodes[before]));
  }
  return found;
}

/* Rows of the table and their weights. */
function neighbours(tau, eta) {
  const found = [], across = weights(ETA.map(Math.log), Math.log(eta));
  for (const [i, a] of Object.entries(weights(TAU.map(Math.log), Math.log(tau))))
    for (const [j, b] of Object.entries(across)) if (a * b !== 0) found.push([i * ETA.length + Number(j), a * b]);
  return found;
}

/* Column ``name`` from entry ``first`` of each row on, interpolated. */
const mixed = (rows, name, long, first = 0, count = long) => Array.from({ length: count }, (_, k) =>
  rows.reduce((sum, [row, weight]) => sum + weight * table[name][row * long + first + k], 0));

/* The flow of a mix, stage by stage: time, slump, slump flow, sinking of the highest point. */
function courseOf(tau, eta) {
  const rows = neighbours(tau, eta), n = table.stages, time = mixed(rows, "time", n).map(Math.exp);
  time[0] = 0;
  for (let k = 1; k < n; k++) time[k] = Math.max(time[k], time[k - 1]);
  const [slump, spread, highest] = ["slump", "spread", "highest"].map((name) => mixed(rows, name, n));
  const found = { rows, time, slump, spread, highest, end: time.at(-1), t500: null };
  const k = spread.findIndex((value) => value >= 0.5);
  if (k > 0) found.t500 = time[k - 1] + ((0.5 - spread[k - 1]) / (spread[k] - spread[k - 1])) * (time[k] - time[k - 1]);
  return found;
}

/* Stage, with its fraction, at a time. */
function stageAt({ time }, now) {
  const k = time.findLastIndex((value) => value <= now);
  return k >= time.length - 1 ? time.length - 1 : k + (now - time[k]) / (time[k + 1] - time[k]);
}

const between = (values, stage) => {
  const k = Math.min(values.length - 2, Math.floor(stage));
  return values[k] + (stage - k) * (values[k + 1] - values[k]);
};

/* Outline (r, z) of the body at a stage, from the floor to the axis. */
function outline(course, stage) {
  const k = Math.min(table.stages - 2, Math.floor(stage)), n = table.rays;
  const away = mixed(course.rows, "away", table.stages * n, k * n, 2 * n);
  const radius = between(course.spread, stage) / 2, high = HEIGHT - between(course.slump, stage);
  return Array.from({ length: n }, (_, i) => {
    const angle = (0.5 * Math.PI * i) / (n - 1), ray = away[i] + (stage - k) * (away[n + i] - away[i]);
    return [radius * ray * Math.cos(angle), high * ray * Math.sin(angle)];
  });
}

/* Class of a mix at rest; a slump flow counts from SF1 on. */
function classOf(course) {
  const is = ([, key, low, high]) => { const read = 10 * Math.round(100 * course[key].at(-1)); return low <= read && read <= high; };
  return [...CLASSES.slice(5), ...CLASSES.slice(0, 5)].find(is)?.[0] ?? (course.slump.at(-1) < 0.1 ? "below S1" : "none");
}

/* Yield stress at which a measure at rest is wanted, by bisection: softer mixes go farther. */
function pullTo(key, wanted) {
  let [low, high] = LIMITS.yield;
  for (let k = 0; k < 30; k++) {
    const middle = Math.sqrt(low * high);
    if (courseOf(middle, state.viscosity)[key].at(-1) > wanted) low = middle;
    else high = middle;
  }
  return Number(low.toPrecision(3));
}

// ---- the picture --------------------------------------------------------------------------------------------------
const circle = (r, z) => Array.from({ length: 49 }, (_, k) => [r * Math.cos((k * Math.PI) / 24), r * Math.sin((k * Math.PI) / 24), z]);
const MOULD = [circle(BASE, 0.0005), circle(TOP, HEIGHT)].flatMap((points) => points.slice(1).flatMap((point, k) => (k % 2 ? [] : [...points[k], ...point])));

/* Places and normals of the outline turned about the axis, on the graphics card. */
function turned(points) {
  const { viewer, mesh } = state, gl = viewer.gl, last = points.length - 1;
  points.forEach(([r, z], i) => {
    const [a, b] = [points[Math.max(0, i - 1)], points[Math.min(last, i + 1)]], long = Math.hypot(b[0] - a[0], b[1] - a[1]) || 1;
    const [out, up] = [(b[1] - a[1]) / long, (a[0] - b[0]) / long];
    for (let s = 0; s < SECTORS; s++) {
      const put = 3 * (i * SECTORS + s), c = mesh.cos[s], d = mesh.sin[s];
      mesh.places.set([r * c, r * d, z], put);
      mesh.normals.set([127 * out * c, 127 * out * d, 127 * up], put);
    }
  });
  for (const [made, values] of [[mesh.at, mesh.places], [mesh.normal, mesh.normals]]) {
    gl.bindBuffer(gl.ARRAY_BUFFER, made);
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
  }
  return mesh;
}

function meshOf(viewer) {
  const count = table.rays * SECTORS, rows = [], angles = Array.from({ length: SECTORS }, (_, s) => (2 * Math.PI * s) / SECTORS);
  for (let i = 0; i < table.rays - 1; i++) for (let s = 0; s < SECTORS; s++) {
    const next = (s + 1) % SECTORS, a = i * SECTORS, b = a + SECTORS;
    rows.push(a + s, a + next, b + s, b + s, a + next, b + next);
  }
  const places = new Float32Array(3 * count), normals = new Int8Array(3 * count);
  return {
    places, normals, cos: angles.map(Math.cos), sin: angles.map(Math.sin), corners: 3, count: rows.length, at: viewer.buffer(places), normal: viewer.buffer(normals),
    shade: viewer.buffer(new Uint8Array(count)), rows: viewer.buffer(new Uint32Array(rows), viewer.gl.ELEMENT_ARRAY_BUFFER),
  };
}

/* The section, where there is no WebGL: a stand-in for the viewer that dimension() asks. */
function section(points) {
  const stage = element("stage"), [wide, tall] = [stage.clientWidth, stage.clientHeight], scale = Math.min((0.94 * wide) / 0.84, (tall - 60) / 0.32);
  const canvas = { clientHeight: tall };
  const flat = { canvas, right: [1, 0, 0], ahead: [0, 1, 0], project: ([x, , z]) => [wide / 2 + scale * x, tall - 46 - scale * z] };
  const line = (some, closed) => some.map(([x, z], k) => `${k ? "L" : "M"}${flat.project([x, 0, z]).map((value) => value.toFixed(1))}`).join("") + (closed ? "Z" : "");
  const mould = [[-BASE, 0], [-TOP, HEIGHT], [TOP, HEIGHT], [BASE, 0]];
  const whole = [...points, ...points.map(([r, z]) => [-r, z]).reverse()];
  element("over").replaceChildren(svg("path", { d: line(whole, true), class: "body" }), svg("path", { d: line(mould), class: "mould" }), svg("path", { d: line([[-0.42, 0], [0.42, 0]]), class: "floor" }));
  return flat;
}

/* Fewer pixels while pictures come late, as without a graphics card; all of them after the last. */
function detail() {
  const late = performance.now() - state.asked, { viewer } = state;
  if (late > SLOW) viewer.detail = Math.max(0.4, 0.8 * viewer.detail);
  clearTimeout(state.rest);
  if (viewer.detail < 1) state.rest = setTimeout(() => { viewer.detail = 1; state.asked = Infinity; paint(); }, 400);
}

function paint() {
  state.due = 0;
  const { course, viewer } = state, stage = stageAt(course, state.time), points = outline(course, stage);
  const slump = between(course.slump, stage), spread = between(course.spread, stage), high = HEIGHT - slump;
  if (viewer) {
    detail();
    viewer.draw(turned(points), { mode: 0, panes: [], lines: [{ points: MOULD, colour: dark.matches ? [1, 0.5, 0.4, 1] : [0.77, 0.24, 0.15, 1] }], dark: dark.matches, size: 0 });
    element("over").replaceChildren();
  }
  const lengths = [{ a: [-spread / 2, 0, 0], b: [spread / 2, 0, 0], near: -spread / 2, text: `slump flow ${(100 * spread).toFixed(1)} cm` }];
  if (slump > 0.004) lengths.push({ a: [0, 0, HEIGHT], b: [0, 0, high], near: 0, text: `slump ${(100 * slump).toFixed(1)} cm` });
  const seen = viewer ?? section(points);
  element("over").append(...lengths.flatMap((each) => dimension(seen, each)));
  element("time").value = stage / (table.stages - 1);
  element("now").textContent = state.time >= course.end ? `${course.end >= 599 ? "after" : "at rest,"} ${written(course.end)}` : written(state.time);
  element("time").setAttribute("aria-valuetext", element("now").textContent);
}

function draw() {
  if (state.due) return;
  state.asked = performance.now();
  state.due = requestAnimationFrame(paint);
}

const written = (seconds) => (seconds < 100 ? `${seconds.toFixed(seconds < 10 ? 2 : 1)} s` : `${seconds.toFixed(0)} s`);

// ---- state, sliders, address ---------------------------------------------------------------------------------------
const toLog = (key, value) => Math.log(value / LIMITS[key][0]) / Math.log(LIMITS[key][1] / LIMITS[key][0]);

/* Show another mix or another time, and tell the numbers of the mix at rest. */
function set(changes) {
  Object.assign(state, changes);
  const units = { yield: "Pa", viscosity: "Pa s" };
  for (const [key, unit] of Object.entries(units)) {
    state[key] = Math.min(LIMITS[key][1], Math.max(LIMITS[key][0], state[key]));
    const text = `${Number(state[key].toPrecision(3))} ${unit}`, slider = element(key);
    slider.value = toLog(key, state[key]);
    slider.setAttribute("aria-valuetext", text);
    element(`${key}-value`).textContent = text;
  }
  const course = (state.course = courseOf(state.yield, state.viscosity)), name = classOf(course);
  const cm = (values) => `${(100 * values.at(-1)).toFixed(1)} cm`;
  const told = { slump: cm(course.slump), flow: cm(course.spread), t500: course.t500 === null ? "not reached" : written(course.t500), class: name };
  for (const [key, text] of Object.entries(told)) element(`${key}-value`).textContent = text;
  const softest = courseOf(LIMITS.yield[0], state.viscosity);
  for (const [each, key, low] of CLASSES) {
    const button = document.querySelector(`button[data-class="${each}"]`);
    button.setAttribute("aria-pressed", each === name);
    button.disabled = 1000 * softest[key].at(-1) < low - 5; // softer than the table
  }
  for (const button of document.querySelectorAll("button[data-case]")) button.setAttribute("aria-pressed", button.dataset.case === `${state.yield},${state.viscosity}`);
  draw();
}

function address() {
  const time = state.time < state.course.end ? `&time=${Number(state.time.toPrecision(4))}` : "";
  history.replaceState(null, "", `#yield=${Number(state.yield.toPrecision(6))}&viscosity=${Number(state.viscosity.toPrecision(6))}${time}`);
}

function read() {
  const told = new URLSearchParams(location.hash.slice(1)), found = {};
  for (const key of ["yield", "viscosity", "time"]) if (told.get(key) && Number(told.get(key)) >= 0) found[key] = Number(told.get(key));
  set({ time: Infinity, ...found });
}

/* Fall, at a speed at which most of it lasts three seconds; where that would be slow, faster. */
function play(on) {
  cancelAnimationFrame(state.playing);
  state.playing = 0;
  element("play").textContent = on ? "Pause" : "Play";
  if (!on) return address();
  const fall = state.course.time[table.stages - 3], speed = [0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100].find((value) => fall / value <= 4) ?? 200;
  element("pace").textContent = speed === 1 ? "real time, its slow end faster" : `${speed}x speed, its slow end faster`;
  if (state.time >= state.course.end) set({ time: 0 });
  let before = null;
  const step = (now) => {
    const passed = Math.min(0.1, (now - (before ?? now)) / 1000), stage = stageAt(state.course, state.time);
    before = now;
    const least = Math.min(table.stages - 1, stage + 3 * passed), time = Math.max(state.time + speed * passed, between(state.course.time, least));
    state.time = time >= state.course.end ? Infinity : time;
    draw();
    if (state.time === Infinity) return play(false);
    state.playing = requestAnimationFrame(step);
  };
  state.playing = requestAnimationFrame(step);
}

function turn(across, up) {
  if (!state.viewer) return;
  state.viewer.turn += across;
  state.viewer.tilt = Math.min(1.5, Math.max(0.02, state.viewer.tilt + up));
  draw();
}

function button(text, where, name, value, pressed) {
  const made = document.createElement("button");
  Object.assign(made, { type: "button", textContent: text, onclick: () => { play(false); pressed(); address(); } });
  made.dataset[name] = value;
  element(where).append(made);
}

/* What draws: a graphics card, or a program in its place, for which edges are not smoothed. */
function renderer() {
  const gl = document.createElement("canvas").getContext("webgl2"), told = gl?.getExtension("WEBGL_debug_renderer_info");
  return told ? String(gl.getParameter(told.UNMASKED_RENDERER_WEBGL)) : "";
}

async function begin() {
  const lines = await Promise.all(["time", "slump", "spread", "highest", "away"].map((name) => inflated(table[name].packed, Int16Array)));
  for (const [k, name] of ["time", "slump", "spread", "highest", "away"].entries())
    table[name] = summed(Float64Array.from(lines[k]), lines[k].length, 1).map((value) => value * table[name].unit);
  for (const key of ["yield", "viscosity"]) {
    element(key).oninput = () => set({ [key]: Number((LIMITS[key][0] * (LIMITS[key][1] / LIMITS[key][0]) ** Number(element(key).value)).toPrecision(3)) });
    element(key).onchange = address;
  }
  element("time").oninput = () => { const to = Number(element("time").value) * (table.stages - 1); play(false); set({ time: to >= table.stages - 1 ? Infinity : between(state.course.time, to) }); address(); };
  element("play").onclick = () => play(!state.playing);
  element("copy").onclick = async () => {
    address();
    try {
      await navigator.clipboard.writeText(location.href);
      element("copied").textContent = "copied";
    } catch { prompt("The link", location.href); }
  };
  for (const [text, tau, eta] of CASES) button(text, "cases", "case", `${tau},${eta}`, () => set({ yield: tau, viscosity: eta, time: Infinity }));
  for (const [name, key, , , wanted] of CLASSES) button(name, "classes", "class", name, () => set({ yield: pullTo(key, wanted / 1000), time: Infinity }));
  const canvas = element("view");
  try {
    const fast = !/swiftshader|llvmpipe|software/i.test(renderer());
    state.viewer = new Viewer(canvas, [[-0.27, -0.27, 0], [0.27, 0.27, HEIGHT]], { floor: 0, tick: 0.05, flat: false, smooth: fast });
    state.mesh = meshOf(state.viewer);
  } catch (error) {
    canvas.remove();
    element("about-view").textContent = `A section, since this browser draws nothing in space (${error.message}).`;
  }
  dragged(canvas, turn);
  canvas.onkeydown = ({ key }) => ({ ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0), ArrowUp: () => turn(0, 0.08), ArrowDown: () => turn(0, -0.08) })[key]?.();
  read();
  window.addEventListener("hashchange", read);
  dark.addEventListener("change", draw);
  new ResizeObserver(draw).observe(element("stage"));
}
const ready = begin();
