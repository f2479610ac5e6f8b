"use strict";
const data = JSON.parse(element("data").textContent), film = data.film, canvas = element("view"), over = element("over");
const MODES = { concrete: 0, distance: 0, speed: 1, flowing: 2 }, HOLD = 1.5; // [s] that the end of the film stays
const STONES = [[0.8, 0.4, 0.18], [0.22, 0.44, 0.66], [0.36, 0.56, 0.3]]; // of sizes of grains in turn
const state = { output: 0, playing: false, viewer: null, meshes: [], grains: [] };

// ---- the film -----------------------------------------------------------------------------------------------------
/* Points, normals, shades and rows of triangles of each picture; a section is turned about the axis. */
async function decoded() {
  const [positions, normals, colours, rows] = await Promise.all([
    inflated(film.positions, Int16Array), inflated(film.normals, Int8Array), inflated(film.colours, Uint8Array), inflated(film.rows, Int32Array)]);
  let first = 0, row = 0;
  return film.counts.map((count, picture) => {
    const links = film.links[picture], c = film.corners[picture], codes = summed(positions.slice(3 * first, 3 * (first + count)), count, 3);
    const at = new Float32Array(3 * count), normal = new Int8Array(3 * count), shade = colours.slice(first, first + count);
    for (let i = 0; i < count; i++) for (let k = 0; k < 3; k++) {
      at[3 * i + k] = film.low[k] + film.step[k] * codes[k * count + i];
      normal[3 * i + k] = normals[3 * first + k * count + i];
    }
    const part = rows.slice(row, row + c * links), triangles = new Uint32Array(c * links);
    for (let i = 0, begin = 0; i < links; i++) {
      begin += part[i];
      for (let k = 0; k < c; k++) triangles[c * i + k] = begin + (k ? part[k * links + i] : 0);
    }
    first += count;
    row += c * links;
    return c === 2 ? turned({ at, normal, shade, triangles }) : { at, normal, shade, triangles };
  });
}

/* Centres of the grains in each picture, and how far each has come. */
async function decodedGrains({ centres, radii, free }) {
  const codes = await inflated(centres, Int16Array), long = 3 * radii.length;
  for (let k = long; k < codes.length; k++) codes[k] += codes[k - long];
  const places = film.times.map((_, k) => Float32Array.from(codes.subarray(k * long, (k + 1) * long), (code, i) => film.low[i % 3] + film.step[i % 3] * code));
  const way = (at) => radii.map((_, g) => Math.hypot(...free.map((on, k) => on * (at[3 * g + k] - places[0][3 * g + k]))));
  return places.map((at) => ({ at, way: way(at) }));
}

/* Colour of a part of the way along the ramp. */
function ramp(part) {
  const at = Math.min(7.999, Math.max(0, 8 * part)), k = Math.floor(at);
  return [0, 1, 2].map((c) => (RAMP[3 * k + c] + (at - k) * (RAMP[3 * k + 3 + c] - RAMP[3 * k + c])) / 255);
}

/* Grains of a picture on the graphics card, in the colours that are chosen. */
function grains(output) {
  const made = state.grains[output], { kinds, radii } = film.grains, { viewer } = state, by = element("colour").value;
  if (made.by !== by) {
    const tone = by === "distance" ? made.way.map((way) => ramp(way / state.farthest)) : kinds.map((kind) => STONES[kind % STONES.length]);
    made.card = { at: viewer.buffer(made.at), tone: viewer.buffer(new Float32Array(tone.flat())), radius: viewer.buffer(new Float32Array(radii)), count: radii.length };
    made.by = by;
  }
  return made.card;
}

function turned({ at, normal, shade, triangles }) {
  const n = film.sectors, count = shade.length, links = triangles.length / 2;
  const made = { at: new Float32Array(3 * n * count), normal: new Int8Array(3 * n * count), shade: new Uint8Array(n * count), triangles: new Uint32Array(6 * n * links) };
  for (let i = 0; i < count; i++) for (let s = 0; s < n; s++) {
    const angle = (2 * Math.PI * s) / n, put = 3 * (i * n + s);
    for (const key of ["at", "normal"]) {
      const [r, , z] = { at, normal }[key].subarray(3 * i, 3 * i + 3);
      made[key].set([r * Math.cos(angle), r * Math.sin(angle), z], put);
    }
    made.shade[i * n + s] = shade[i];
  }
  for (let i = 0; i < links; i++) for (let s = 0; s < n; s++) {
    const next = (s + 1) % n, a = triangles[2 * i] * n, b = triangles[2 * i + 1] * n;
    made.triangles.set([a + s, b + s, a + next, b + s, b + next, a + next], 6 * (i * n + s));
  }
  return made;
}

function mesh(output) { // on the graphics card, once
  const made = state.meshes[output], viewer = state.viewer;
  made.card ??= { at: viewer.buffer(made.at), normal: viewer.buffer(made.normal), shade: viewer.buffer(made.shade), rows: viewer.buffer(made.triangles, viewer.gl.ELEMENT_ARRAY_BUFFER), corners: film.corners[output], count: film.corners[output] ? made.triangles.length : made.shade.length };
  return made.card;
}

// ---- the view -----------------------------------------------------------------------------------------------------
/* Pairs of places of polylines x, y, z with null between; dashed by leaving out every third part. */
function segments([x, y, z], dashed) {
  const found = [], step = 0.012 * Math.max(...subtract(data.high, data.low));
  for (let k = 1; k < x.length; k++) {
    if (x[k] === null || x[k - 1] === null) continue;
    const a = [x[k - 1], y[k - 1], z[k - 1]], b = [x[k], y[k], z[k]], parts = dashed ? Math.max(1, 2 * Math.floor(Math.hypot(...subtract(b, a)) / step / 2)) : 1;
    const at = (fraction) => a.map((value, i) => value + fraction * (b[i] - value));
    if (dashed && parts === 1 && k % 3 === 0) continue;
    for (let part = 0; part < parts; part += 2) found.push(...at(part / parts), ...at(Math.min(1, (part + 1) / parts)));
  }
  return found;
}

function draw() {
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  const lines = [{ points: segments(data.outline, true), colour: dark ? [1, 0.5, 0.4, 1] : [0.77, 0.24, 0.15, 1] }, { points: segments(data.walls), colour: [0.5, 0.53, 0.57, 1] }];
  const size = 1.24 * data.size, mode = MODES[element("colour").value], stones = film.grains && mode === 0;
  const inside = stones ? { grains: grains(state.output), cut: element("mortar").value === "cut" ? 0.5 * (data.low[1] + data.high[1]) : null } : {};
  state.viewer.draw(mesh(state.output), { mode, ...inside, panes: data.vessel, lines: lines.filter((line) => line.points.length), dark, size });
  over.replaceChildren(...film.dimensions[state.output].flatMap((each) => dimension(state.viewer, each)));
}

function show(output) {
  state.output = output;
  element("time").value = output;
  element("now").textContent = `${film.times[output].toFixed(2)} s`;
  draw();
}

/* Flow time over time of the film, such that it lasts some seconds, and its words. */
function pace() {
  const long = film.times.at(-1) - film.times[0];
  const speed = long < 1.2 ? [0.5, 0.25, 0.1, 0.05, 0.02, 0.01].find((value) => long / value >= 1.2) ?? 0.01 : [1, 2, 5, 10, 20, 50, 100, 200, 500].find((value) => long / value <= 12) ?? 1000;
  const words = { 1: "real time", 0.5: "half speed", 0.25: "quarter speed", 2: "double speed" };
  return [speed, words[speed] ?? `${speed}x speed`];
}

function play(on) {
  state.playing = on;
  element("play").textContent = on ? "Pause" : "Play";
  const [speed] = pace(), last = film.times.length - 1;
  let begun = performance.now(), from = state.output >= last ? film.times[0] : film.times[state.output];
  const step = (now) => {
    if (!state.playing) return;
    const time = from + ((now - begun) / 1000) * speed;
    if (time > film.times[last] + HOLD * speed) [begun, from] = [now, film.times[0]];
    let next = 0;
    while (next < last && film.times[next + 1] <= time) next++;
    if (next !== state.output) show(next);
    requestAnimationFrame(step);
  };
  if (on) requestAnimationFrame(step);
}

function turn(across, up) {
  if (state.viewer.flat) return;
  state.viewer.turn += across;
  state.viewer.tilt = Math.min(1.5, Math.max(0.02, state.viewer.tilt + up));
  draw();
}

function zoom(factor) {
  state.viewer.zoom = Math.min(6, Math.max(0.4, state.viewer.zoom * factor));
  draw();
}

async function begin() {
  const size = Math.max(...subtract(data.high, data.low));
  const tick = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1].find((value) => value >= size / 14) ?? 2;
  state.viewer = new Viewer(canvas, [data.low, data.high], { floor: data.floor, tick, flat: data.dimension === 2 });
  document.body.classList.add("moving");
  element("time").max = film.times.length - 1;
  element("time").oninput = () => { play(false); show(Number(element("time").value)); };
  element("play").onclick = () => play(!state.playing);
  element("colour").onchange = () => { element("key").className = element("colour").value; draw(); };
  if (film.grains) {
    element("mortar").onchange = draw;
    const name = film.grains.sizes.map((size, k) => `<i style="background:rgb(${STONES[k % STONES.length].map((part) => Math.round(255 * part))})"></i> ${size} mm`);
    element("sizes").innerHTML = name.join(" ");
    element("farthest").textContent = `${(100 * state.farthest).toPrecision(2)} cm`;
  } else document.querySelectorAll(".of-grains").forEach((each) => each.remove());
  element("nearer").onclick = () => zoom(1.25);
  element("farther").onclick = () => zoom(0.8);
  element("pace").textContent = pace()[1];
  element("fastest").textContent = `${film.fastest.toPrecision(2)} m/s`;
  canvas.onpointerdown = (down) => canvas.setPointerCapture(down.pointerId);
  canvas.onpointermove = (move) => { if (canvas.hasPointerCapture(move.pointerId)) turn(0.008 * move.movementX, 0.006 * move.movementY); };
  canvas.onkeydown = ({ key }) => ({ ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0), ArrowUp: () => turn(0, 0.08), ArrowDown: () => turn(0, -0.08), "+": () => zoom(1.25), "-": () => zoom(0.8) })[key]?.();
  new ResizeObserver(draw).observe(canvas);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  show(still ? film.times.length - 1 : 0);
  play(!still);
}

async function write() {
  data.charts.forEach((each) => chart(each, element("charts")));
  const name = (what) => `${document.title} ${what}`.replace(/[^\w-]+/g, "-");
  const table = [...document.querySelectorAll("#results tr")].map((row) => [...row.cells].map((cell) => cell.textContent));
  element("save-curves").onclick = () => save(name("curves"), columns(data.charts));
  element("save-results").onclick = () => save(name("results"), results(table));
  try {
    state.meshes = await decoded();
    state.grains = film.grains ? await decodedGrains(film.grains) : [];
    state.farthest = Math.max(1e-9, ...(state.grains.at(-1)?.way ?? []));
    const { middle } = data.section;
    cross(data.section, middle === undefined ? null : sliced(state.meshes.at(-1), middle, data.floor), element("section"));
    if (data.filling) filled(data.filling, element("section"));
    await begin();
  } catch (error) { // without WebGL or DecompressionStream the picture stays
    element("why").textContent = `This browser shows no moving film (${error.message}); the picture is the end of the run.`;
  }
}
const ready = write();
