// The page: which test, its form, preview and run. All that is set stands in the address.

import {ask, by, en206, h, icon, inTime, listen, question, told, unitOf, usual} from "./ask.js";
import {Body} from "./body.js";
import {Calibrate} from "./calibrate.js";
import {Runs} from "./runs.js";
import {Stage} from "./stage.js";

const REST = 110; // [ms] after which a slider rests
const HIGHEST = "slump_max_m"; // the slump at the highest point
const TICK = 700; // [ms] between two looks at the jobs
const TESTS = {
  slump: "Slump", flow: "Slump flow", flow_table: "Flow table", l_box: "L-box", v_funnel: "V-funnel",
  j_ring: "J-ring", wall: "Form", printing: "Printing", mini_cone: "Mini-cone", u_box: "U-box", l_flow: "L-flow", lcpc_box: "LCPC box",
  film: "Slope", vane: "Rheometer", dam_break: "Dam break", still_pool: "Still pool",
};
const PRESETS = {flow: {test: "slump", values: {yield_value: "60", plastic_viscosity: "30"}}};
const HEADS = {mix: "mix", test: "test", "accuracy and cost": "accuracy and cost", output: "output", expert: "expert"};

const state = {tests: {}, chosen: null, values: {}, mode: "preview", job: null, known: null};
const stage = new Stage(by("section"), by("time"), by("again"));
const body = new Body(by("stage"), by("solid"), by("over"), by("time"));
let calling = null, checking = 0, resting = null, runs, calibrate;

// ---- the address ----------------------------------------------------------------------------------------------

function address() {
  const set = new URLSearchParams(state.values).toString();
  return `#${state.chosen}${set && `?${set}`}`;
}

function go(hash) {
  history.pushState(null, "", hash);
  route();
}

function route() {
  const [path, query] = location.hash.slice(1).split("?");
  const [page, ...rest] = path.split("/");
  const values = Object.fromEntries(new URLSearchParams(query));
  const place = {runs: "runs", compare: "runs", calibrate: "calibrate"}[page] || "run";
  for (const id of ["run", "runs", "calibrate"]) by(id).hidden = id !== place;
  document.title = `${{runs: "Runs", compare: "Compare", calibrate: "Calibrate"}[page] || TESTS[page] || "Slump"} - taichi_mps`;
  for (const link of document.querySelectorAll("nav a"))
    link.toggleAttribute("aria-current", link.dataset.page === (place === "run" ? page || "slump" : place));
  calling?.abort();
  if (place === "runs") runs.show(page, rest.map(decodeURIComponent).join("/"), new URLSearchParams(query).getAll("run"));
  else if (place === "calibrate") calibrate.show(values);
  else choose(state.tests[PRESETS[page]?.test || page] ? page : "slump", values);
}

// ---- the form -------------------------------------------------------------------------------------------------

function test() {
  return state.tests[PRESETS[state.chosen]?.test || state.chosen];
}

function fields() {
  return test().fields[state.values.scheme] || test().fields.implicit;
}

function choose(name, values) {
  const other = name !== state.chosen;
  state.chosen = name;
  state.values = Object.keys(values).length ? values : {...PRESETS[name]?.values, ...values};
  for (const key of Object.keys(state.values)) if (!fields().some((field) => field.name === key)) delete state.values[key];
  if (other) {
    wrong({});
    state.known = null;
    state.changed = false;
    for (const id of ["forecast", "remarks"]) by(id).replaceChildren();  // of the test before
    button();
    numbers({}, {}, "");
    stage.clear();
    body.hide();
    delete by("stage").dataset.old;
    mode("preview");
  }
  if (other || state.scheme !== state.values.scheme) draw();
  for (const field of fields()) write(field.name, state.values[field.name] || "");
  by("headline").textContent = test().help;
  by("nothing").replaceChildren(icon(name), h("p", {}, "This test has no preview. What a run of it takes is told beside the button."));
  for (const link of by("tests").children) link.tabIndex = link.dataset.page === name ? 0 : -1;  // one stop of the keyboard
  document.querySelector("#tests a[aria-current]")?.scrollIntoView({block: "nearest", inline: "nearest"});
  look();
}

function draw() {
  state.scheme = state.values.scheme;
  const groups = {};
  by("sliders").replaceChildren();
  for (const field of fields()) {
    const made = control(field);
    if (field.ends) by("sliders").append(made);
    else (groups[field.group] ||= h("fieldset", {}, h("legend", {}, HEADS[field.group]))).append(made);
  }
  by("fields").replaceChildren(...Object.values(groups));
}

function control(field) {
  const id = `field-${field.name}`, label = h("label", {for: id, title: field.help}, field.label);
  const changed = (event) => set(field.name, event.target.value);
  if (field.words.length) {
    const usual = field.usual ? `${field.usual} (usual)` : "usual";
    const options = [h("option", {value: ""}, usual), ...field.words.filter((word) => word !== field.usual).map((word) => h("option", {}, word))];
    const made = h("select", {id, "data-field": field.name, onchange: changed}, options);
    return h("div.field", {title: field.help}, label, made, h("p.wrong", {id: `${id}-wrong`}));
  }
  const shown = {id, "data-field": field.name, placeholder: usual(field), "aria-describedby": `${id}-wrong`, spellcheck: "false"};
  const made = h("input", {...shown, inputmode: field.unit ? "decimal" : "text", oninput: changed});
  const row = h("div.field", {title: field.help}, label, made, h("span.unit", {}, unitOf(field, "")), h("p.wrong", {id: `${id}-wrong`}), h("p.asked"));
  if (field.ends) {
    const slide = (event) => {
      const [low, high] = field.ends, value = low * (high / low) ** (event.target.value / 1000);
      made.value = Number(value.toPrecision(2));
      set(field.name, made.value);
    };
    row.append(h("input", {type: "range", min: 0, max: 1000, "data-slider": field.name, "aria-label": field.label, oninput: slide}));
  }
  return row;
}

// Put a text into its input, and the slider where it belongs.
function write(name, text) {
  const input = by(`field-${name}`), field = fields().find((it) => it.name === name);
  if (!input) return;
  if (document.activeElement !== input) input.value = text;
  const row = input.closest(".field"), asked = row.querySelector(".asked");
  if (asked) {
    row.querySelector(".unit").textContent = unitOf(field, text);
    question(field, text, asked, (words) => { input.value = words; set(name, words); });
  }
  const slider = document.querySelector(`[data-slider="${name}"]`);
  if (!slider || document.activeElement === slider) return;
  const [low, high] = field.ends, kilo = /k(Pa|\s)/.test(text) ? 1000 : 1;
  const value = text ? kilo * parseFloat(text.replace(",", ".")) : field.default;
  if (value > 0) slider.value = (1000 * Math.log(value / low)) / Math.log(high / low);
}

function set(name, text) {
  if (text.trim()) state.values[name] = text.trim();
  else delete state.values[name];
  history.replaceState(null, "", address());
  if (name === "scheme") {
    for (const key of Object.keys(state.values)) if (!fields().some((field) => field.name === key)) delete state.values[key];
    draw();
    for (const field of fields()) write(field.name, state.values[field.name] || "");
  }
  write(name, text);
  mode("preview");
  checking++;  // an answer under way is of the mix before
  state.changed = true;
  state.known = {space: state.known?.space};  // the forecast is of the mix before, as are numbers and body
  button();
  for (const id of ["verdict", "numbers", "stage"]) by(id).dataset.old = "";
  mark(name, "");
  source("");
  clearTimeout(resting);
  resting = setTimeout(look, REST);
}

// ---- preview and forecast ---------------------------------------------------------------------------------------

function look() {
  clearTimeout(resting);
  forecast();
  preview();
}

async function forecast() {
  const number = ++checking;
  const known = await ask("forecast", {test: test().name, values: state.values});
  if (number !== checking) return;
  state.known = known;
  wrong(known.wrong || {});
  by("remarks").replaceChildren(...(known.remarks || []).map((text) => h("p.remark", {}, text)));
  by("forecast").replaceChildren(...(known.lines || []).map((text) => h("p", {}, text)));
  button();
  if (known.wrong && state.mode === "preview") numbers({}, {}, "");
  else if (known.table && !state.computed && state.mode === "preview") numbers(known.table, {}, test().preview ? "Estimate; preview is coming." : "Estimate; this test has no preview.");
  if (known.wrong || (test().preview && stage.frames.length)) return;
  const before = state.changed || test().preview ? null : ((await ask("list")).runs || []).find((run) => run.scene === test().name && run.whole && run.report);
  if (number !== checking) return;
  if (before && state.mode === "preview") {
    numbers(before.numbers, before.errors, `Last run of this test, ${before.name}: ${before.mix}; ${before.end}`, before.verdict);
    await body.report(before.report);
  } else if (known.beginning && state.mode === "preview") {
    delete by("stage").dataset.old;
    await body.show(known.beginning, "before it flows, to scale");
    if (number !== checking) return;
    if (test().preview && stage.frames.length) return body.hide();  // which was sooner
    if (!known.table && !test().preview) numbers({}, {}, `This test has no preview. ${known.lines?.[1] || ""}`);
  } else if (state.mode === "preview") body.hide();
  by("nothing").replaceChildren(icon(state.chosen), h("p", {}, "This test has no preview. ", known.lines?.[1] || ""));
}

// What is wrong, at its field; what belongs to none above the button.
function wrong(messages) {
  let rest = messages[""] || "";
  for (const field of fields()) mark(field.name, (messages[field.name] || "").replace("must be left out", "must be left out: empty its field"));
  for (const [key, text] of Object.entries(messages)) if (key && !by(`field-${key}`)) rest += text;
  by("wrong").textContent = rest;
}

// A message at its own field, which needs no name and no value in it.
function mark(name, text) {
  const input = by(`field-${name}`);
  if (!input) return;
  by(`field-${name}-wrong`).textContent = told(name, text);
  input.toggleAttribute("aria-invalid", Boolean(text));
  if (text) input.closest("details")?.setAttribute("open", "");
}

async function preview() {
  calling?.abort();
  by("stage").dataset.test = test().preview ? "moving" : "still";
  if (test().preview) body.hide();
  state.computed = false;
  if (!test().preview) return;
  const call = (calling = new AbortController()), start = performance.now();
  performance.mark("preview");
  try {
    for await (const part of listen("preview", {test: test().name, values: state.values}, call.signal)) {
      if (call.signal.aborted) return;
      if (part.preparing && !state.computed) source("Compiling …");
      if (part.remark) notice(part.remark);
      if (part.wrong) source("");
      if (part.stage) stage.begin(part.stage), delete by("stage").dataset.old;
      if (part.t !== undefined) {
        if (!stage.frames.length) body.hide(), by("stage").dataset.first = Math.round(performance.now() - start);
        stage.add(part);
      }
      if (part.result) {
        const {m, errors, time, spacing, last, ended} = part.result;
        stage.resting = ended === "rest";
        stage.finish(time);
        state.computed = true;
        by("stage").dataset.result = Math.round(performance.now() - start);
        const known = Object.keys(errors).length ? "± by the measured errors of such a preview" : "no accuracy data";
        const size = `particles of ${Number((1000 * spacing).toPrecision(3))} mm`;
        const end = {rest: "", time: ", still moving", diverged: ", which this preview cannot follow to its end"}[ended] ?? "";
        const section = test().preview.model === "plane" ? "a section without side walls, with" : "a section with";
        numbers(m, errors, `Preview, ${section} ${size}${end}; ${known}.${last ? "" : " It is being refined."}`);
      }
    }
  } catch (error) {
    if (error.name !== "AbortError") source("The preview does not answer.");
  }
}

function numbers(m, errors, words, verdict = "") {
  by("verdict").textContent = verdict;
  const other = (key) => key === HIGHEST || (key === "t500_s" && test().name !== "slump");  // no T500 of a small cone
  const cells = Object.entries(m).filter(([key]) => !other(key)).slice(0, 4).map(([key, [value, text, name]]) => {
    const read = key === "slump_m" ? m[HIGHEST]?.[0] : value;  // EN 12350-2 reads the highest point
    const off = errors[key], kind = read == null || !standard() ? "" : en206(key, read);
    const small = value === null ? text : off ? `± ${off < 0.01 ? `${(1000 * off).toFixed(0)} mm` : `${(100 * off).toFixed(1)} cm`}` : "";
    const by206 = key === "slump_m" ? `class by EN 206: ${m[HIGHEST]?.[1]} at the highest point` : "class by EN 206";
    return h("div.number", {"data-number": key}, h("span.name", {}, name), h("b", {}, value === null ? "–" : text),
      h("span.off", {}, small), kind && h("span.class", {title: by206}, kind));
  });
  by("numbers").replaceChildren(...cells);
  for (const id of ["verdict", "numbers"]) delete by(id).dataset.old;
  source(words);
}

// Whether it is the standard's cone, of which the classes speak.
function standard() {
  return test().name === "slump" && !["height", "base_diameter", "top_diameter"].some((key) => state.values[key]);
}

function source(words) {
  by("source").textContent = words;
}

function notice(words) {
  by("notice").hidden = !words;
  by("notice").replaceChildren(words || "", h("button.quiet", {type: "button", "aria-label": "close", onclick: () => notice("")}, "×"));
}

// ---- run ----------------------------------------------------------------------------------------------------------

// What the stage shows: the preview, or a run, of which a preview that comes late says nothing any more.
function mode(name) {
  if (name === "run") calling?.abort(), delete by("stage").dataset.old;
  state.mode = name;
  by("stage").dataset.mode = name;
}

function button() {
  const {known} = state, busy = state.job && !["done", "stopped", "failed"].includes(state.job.state);
  const made = by("go"), time = known?.seconds ? `, about ${inTime(known.seconds)}` : "";
  made.dataset.action = busy ? "stop" : "run";
  made.disabled = !busy && !known?.lines;
  const ready = known?.lines || known?.wrong ? time : ", estimating …";
  made.textContent = busy ? (state.job.stopping ? "Stop at once" : "Stop") : `${known?.space === false ? "Run" : "Run in 3-D"}${ready}`;
}

async function press(event) {
  event.preventDefault();
  if (by("go").dataset.action === "stop") await ask("stop", {job: state.job.id, at_once: state.job.stopping});
  else {
    clearTimeout(resting);
    const answer = await ask("run", {test: test().name, values: state.values});
    if (answer.wrong) return wrong(answer.wrong);
    notice("");
    state.own = answer.job;
    mode("run");
    by("status").textContent = "";  // what it says of the run before
    by("picture").removeAttribute("src");
  }
  await tick();
}

// What has changed on the server.
async function tick() {
  if (document.hidden) return;
  const calibration = calibrate.job;
  const {jobs = [], last, lost} = await ask("jobs");
  if (lost) return;
  const before = state.job;
  const own = jobs.filter((job) => job.test === test()?.name);  // Stop stands only where its test is shown
  state.job = own.find((job) => job.state === "running") || own.find((job) => job.state === "waiting") || own.at(-1) || null;
  const {job} = state, over = job && ["done", "stopped", "failed"].includes(job.state);
  if (job && !over && !before && state.mode === "preview") mode("run");
  if (job && state.mode === "run") follow(job);
  if (over && (before?.id !== job.id || before?.state !== job.state) && job.state === "failed" && before) notice(`${job.title}: ${job.message}`);
  if (over && before && before.id === job.id && before.state !== job.state && state.mode === "run") finished(job, last);
  if (JSON.stringify(last) !== state.last) lastRun(last);
  by("last").dataset.job = job?.state || "";
  button();
  runs.tick(jobs);
  if (calibration === calibrate.job) calibrate.tick(jobs);  // else this is an answer from before its job
}

function follow(job) {
  const waits = job.state === "waiting";
  const about = job.left === null ? job.about : job.spent + job.left;
  const spent = `${Math.round(job.spent)} s${about ? ` of about ${inTime(Math.max(about, job.spent))}` : ""}`;
  const now = job.flow === null ? "Compiling …" : `the concrete at ${job.flow.toFixed(2)} s. ${job.result}`;
  const where = job.stopping ? `Stopping ${job.flow === null ? "once compiled" : "after this step"} …` : now;
  if (!["done", "stopped", "failed"].includes(job.state)) {
    by("status").textContent = waits ? `${job.title}: waits until the one before is done` : `${spent}: ${where}`;
    by("bar").firstElementChild.style.width = `${100 * Math.min(1, about ? job.spent / about : 0)}%`;
    by("stage").dataset.job = job.state;
    if (job.picture) body.hide(), by("picture").src = job.picture;
    by("picture").alt = job.title;
    source(job.title);
    for (const id of ["verdict", "numbers"]) by(id).replaceChildren();
  }
}

async function finished(job, last) {
  by("stage").dataset.job = job.state;
  by("status").textContent = job.state === "stopped" ? "stopped by you" : "";
  if (job.state === "failed" || !job.run) return mode("preview"), look();
  const run = await ask("show", {names: [job.run]});
  if (run.wrong) return source(`${job.title}: stopped before it began`);  // it has no folder yet
  if (run.film) by("picture").src = run.film;
  if (run.report) body.report(run.report);
  const stopped = job.state === "stopped";  // what it had reached by then is no result
  numbers(stopped ? {} : run.numbers, run.errors, `${run.name}: ${run.mix}; ${run.end}${stopped ? `. ${run.result}` : ""}`, stopped ? "" : run.verdict);
}

// The last run with a result: whatever came later, it stays.
function lastRun(last) {
  state.last = JSON.stringify(last);
  by("last").hidden = !last;
  if (!last) return;
  by("last").replaceChildren(
    ...(last.picture ? [h("img", {src: last.picture, alt: ""})] : []),
    h("div", {}, h("b", {}, "Last run "), h("span", {}, `${last.verdict} ${last.result}`), h("p", {}, `${last.test}, ${last.mix}`)),
    h("a.button", {href: `#runs/${encodeURIComponent(last.name)}`, "data-action": "open"}, "open"),
    ...(last.report ? [h("a.button", {href: last.report, target: "_blank", rel: "noopener"}, "report")] : []),
  );
}

// ---- begin --------------------------------------------------------------------------------------------------------

by("about").open = innerWidth > 820;
const given = await ask("tests");
for (const each of given.tests || []) state.tests[each.name] = each;
const order = Object.keys(TESTS).filter((name) => state.tests[PRESETS[name]?.test || name]);
const others = Object.keys(state.tests).filter((name) => !TESTS[name]);
by("tests").append(...[...order, ...others].map((name) =>
  h("a", {href: `#${name}`, "data-page": name, "data-test": name, title: state.tests[PRESETS[name]?.test || name].help,
    onclick: (event) => {
      event.preventDefault();
      const names = state.chosen ? fields().filter((field) => field.group === "mix").map((field) => field.name) : [];
      const preset = PRESETS[state.chosen]?.values || {}, given = names.filter((key) => state.values[key]);
      const typed = given.some((key) => state.values[key] !== preset[key]);
      const mix = new URLSearchParams(typed ? given.map((key) => [key, state.values[key]]) : []);
      go(`#${name}${mix.size ? `?${mix}` : ""}`);
    }}, icon(name), h("span", {}, TESTS[name] || name))));
by("tests").addEventListener("keydown", (event) => {
  const next = {ArrowLeft: "previousElementSibling", ArrowRight: "nextElementSibling"}[event.key];
  if (next && event.target[next]) event.preventDefault(), event.target[next].focus();
});
runs = new Runs(by("runs"), go);
calibrate = new Calibrate(by("calibrate"), given.measurements || [], go);
by("mix").addEventListener("submit", press);
by("mix").addEventListener("keydown", (event) => {  // Enter ends a field; only the button runs
  if (event.key === "Enter" && event.target.matches("input, select")) event.preventDefault(), look();
});
addEventListener("popstate", route);
addEventListener("hashchange", route);
setInterval(tick, TICK);
route();
tick();
