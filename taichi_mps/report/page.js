"use strict";
const data = JSON.parse(element("data").textContent), film = data.film, canvas = element("view"), over = element("over");
const MODES = { concrete: 0, distance: 0, speed: 1, flowing: 2 }, HOLD = 1.5; // [s] that the end of the film stays
const state = { output: 0, playing: false, viewer: null, meshes: [], grains: [] };

// ---- grains -------------------------------------------------------------------------------------------------------
/* Colour of a part of the way along the ramp. */
function ramp(part) {
  const at = Math.min(7.999, Math.max(0, 8 * part)), k = Math.floor(at);
  return [0, 1, 2].map((c) => (RAMP[3 * k + c] + (at - k) * (RAMP[3 * k + 3 + c] - RAMP[3 * k + c])) / 255);
}

/* Grains of a picture on the graphics card, in the colours that are chosen. */
function grains(output) {
  const made = state.grains[output], by = element("colour").value;
  if (made.by !== by) delete made.card;
  made.by = by;
  return grainsOnCard(state.viewer, made, film.grains, by === "distance" ? made.way.map((way) => ramp(way / state.farthest)) : undefined);
}

// ---- the view -----------------------------------------------------------------------------------------------------
function draw() {
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  const mode = MODES[element("colour").value], stones = film.grains && mode === 0;
  const inside = stones ? { grains: grains(state.output), cut: element("mortar").value === "cut" ? 0.5 * (data.low[1] + data.high[1]) : null } : {};
  state.viewer.draw(onCard(state.viewer, state.meshes[state.output]), { mode, ...inside, ...around(data, dark) });
  over.replaceChildren(...film.dimensions[state.output].flatMap((each) => dimension(state.viewer, each)));
}

function show(output) {
  state.output = output;
  element("time").value = output;
  element("now").textContent = `${film.times[output].toFixed(2)} s`;
  draw();
}

function play(on) {
  state.playing = on;
  element("play").textContent = on ? "Pause" : "Play";
  const [speed] = pace(film), last = film.times.length - 1;
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
  state.viewer = new Viewer(canvas, ...fitting(data));
  document.body.classList.add("moving");
  element("time").max = film.times.length - 1;
  element("time").oninput = () => { play(false); show(Number(element("time").value)); };
  element("play").onclick = () => play(!state.playing);
  element("colour").onchange = () => { element("key").className = element("colour").value; draw(); };
  if (film.grains) {
    element("mortar").onchange = draw;
    const { sizes, colours } = film.grains;
    const name = sizes.map((size, k) => `<i style="background:rgb(${colours[k % colours.length].map((part) => Math.round(255 * part))})"></i> ${size} mm`);
    element("sizes").innerHTML = name.join(" ");
    element("farthest").textContent = `${(100 * state.farthest).toPrecision(2)} cm`;
  } else document.querySelectorAll(".of-grains").forEach((each) => each.remove());
  element("nearer").onclick = () => zoom(1.25);
  element("farther").onclick = () => zoom(0.8);
  element("pace").textContent = pace(film)[1];
  element("fastest").textContent = `${film.fastest.toPrecision(2)} m/s`;
  dragged(canvas, turn);
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
    state.meshes = await decoded(film);
    state.grains = await decodedGrains(film);
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
