// The mix of measured tests: the answer first, then one picture, then the reasons; or a laboratory's list of them.

import {ask, h, listen, question, reason, told, unitOf} from "./ask.js";
import {table} from "./runs.js";
import {Stage} from "./stage.js";

const CONSTANTS = {yield_value: "yield stress [Pa]", plastic_viscosity: "plastic viscosity [Pa s]", friction_angle: "internal friction [degrees]"};
const MOST_BYTES = 7e6, MOST_ROWS = 200;  // of a list; of its table on the page
const FIRST = ["slump", "spread", "t500", "mini_cone", "v_funnel"];
const FIRST_WORDS = "Results appear here.";

export class Calibrate {
  constructor(place, measurements, go) {
    Object.assign(this, {measurements, go, values: {}, job: null, state: null});
    this.inputs = {};
    const control = (field) => {
      const id = `measured-${field.name}`;
      const shown = {id, "data-field": `calibrate-${field.name}`, placeholder: field.usual || (field.unit === "m" ? "– cm" : "–"), "aria-describedby": `${id}-wrong`};
      this.inputs[field.name] = h("input", {...shown, inputmode: "decimal", oninput: (event) => this.set(field.name, event.target.value)});
      return h("div.field", {title: field.help}, h("label", {for: id}, field.label), this.inputs[field.name],
        h("span.unit"), h("p.wrong", {id: `${id}-wrong`}), h("p.asked"));
    };
    const [first, others] = [measurements.filter((it) => FIRST.includes(it.name)), measurements.filter((it) => !FIRST.includes(it.name))];
    this.check = h("input", {type: "checkbox", checked: true, id: "finer"});
    this.button = h("button", {type: "submit", "data-action": "calibrate"}, "Calibrate");
    this.wrong = h("p.wrong", {role: "alert"});
    this.canvas = h("canvas", {"aria-label": "the measured cone over that of the model", role: "img"});
    this.answer = h("div.answer", {"data-part": "answer", "aria-live": "polite"});
    this.figure = h("figure.compared", {hidden: true}, this.canvas);
    this.reasons = h("div");
    const chosen = (event) => { this.list(event.target.files[0]); event.target.value = ""; };
    this.file = h("input", {type: "file", id: "list", accept: ".csv,.txt,.tsv,.xlsx", "data-field": "list", "aria-describedby": "list-wrong", onchange: chosen});
    const drop = h("div.drop", {}, h("label", {for: "list"}, "Or drop a list here, CSV or Excel (.xlsx): a mix a line, columns as slump [cm], slump flow [mm], T500 [s]"),
      this.file, h("p.wrong", {id: "list-wrong", role: "alert"}));
    place.addEventListener("dragover", (event) => { event.preventDefault(); drop.classList.add("over"); });
    place.addEventListener("dragleave", () => drop.classList.remove("over"));
    place.addEventListener("drop", (event) => { event.preventDefault(); drop.classList.remove("over"); this.list(event.dataTransfer.files[0]); });
    place.append(
      h("form", {autocomplete: "off", onsubmit: (event) => this.press(event)},
        h("h1", {}, "Which mix is it? Give what was measured, one test or more."),
        first.map(control),
        h("details", {}, h("summary", {}, "density, rheometer, errors of the measurements"), others.map(control)),
        h("label.tick", {for: "finer"}, this.check, "check by one finer run, some 20 s; above 55 cm of slump flow some minutes"),
        this.wrong, this.button, drop),
      h("div.view", {}, this.answer, this.figure, this.reasons));
    this.stage = new Stage(this.canvas);
  }

  show(values) {
    this.values = values;
    for (const [name, input] of Object.entries(this.inputs)) if (document.activeElement !== input) input.value = values[name] || "";
    for (const field of this.measurements) this.unit(field, values[field.name] || "");
    if (!this.answer.textContent) this.answer.textContent = FIRST_WORDS;
  }

  unit(field, text) {
    const input = this.inputs[field.name], row = input.closest(".field");
    row.querySelector(".unit").textContent = text.trim() || field.unit !== "m" || field.usual ? unitOf(field, text) : "";
    question(field, text, row.querySelector(".asked"), (words) => { input.value = words; this.set(field.name, words); });
  }

  set(name, text) {
    this.unit(this.measurements.find((field) => field.name === name), text);
    if (text.trim()) this.values[name] = text.trim();
    else delete this.values[name];
    document.getElementById(`measured-${name}-wrong`).textContent = "";
    this.inputs[name].removeAttribute("aria-invalid");
    const set = new URLSearchParams(this.values).toString();
    history.replaceState(null, "", `#calibrate${set && `?${set}`}`);
  }

  async press(event) {
    event.preventDefault();
    if (this.job !== null) {
      await ask("stop", {job: this.job});
      return;
    }
    const answer = await this.begin("calibrate", {values: this.values, check: this.check.checked});
    if (answer.wrong) this.mark(answer.wrong);
  }

  // Ask for a calibration, which becomes the job of this page unless something is wrong.
  async begin(what, query) {
    this.mark({});
    document.getElementById("list-wrong").textContent = "";
    this.answer.replaceChildren(h("p", {}, "Calibrating …"), h("progress"));
    this.answer.scrollIntoView({block: "nearest"});
    this.figure.hidden = this.button.disabled = true;
    this.reasons.replaceChildren();
    const answer = await ask(what, query);
    this.button.disabled = false;
    if (answer.wrong) this.answer.textContent = FIRST_WORDS;
    else {
      this.job = answer.job;
      this.button.textContent = "Stop";
    }
    return answer;
  }

  // A laboratory's list, chosen or dropped.
  async list(file) {
    if (!file || this.job !== null) return;
    const wrong = document.getElementById("list-wrong");
    if (file.size > MOST_BYTES) return (wrong.textContent = `${file.name} has more than ${MOST_BYTES / 1e6} MB.`);
    this.named = file.name.replace(/\.\w+$/, "");
    const bytes = new Uint8Array(await file.arrayBuffer());
    let text = "";
    for (let k = 0; k < bytes.length; k += 1 << 15) text += String.fromCharCode(...bytes.subarray(k, k + (1 << 15)));
    const answer = await this.begin("calibrate_list", {file: btoa(text)});
    if (answer.wrong) wrong.textContent = `${file.name}: ${told("table", reason(answer))}`;
  }

  // What is wrong, at its field; what belongs to none below the form.
  mark(wrong) {
    for (const [name, input] of Object.entries(this.inputs)) {
      const text = wrong[name] || "";
      document.getElementById(`measured-${name}-wrong`).textContent = told(name, text);
      input.toggleAttribute("aria-invalid", Boolean(text));
      if (text) input.closest("details")?.setAttribute("open", "");
    }
    const rest = Object.keys(wrong).filter((name) => !(name in this.inputs));
    this.wrong.textContent = rest.map((name) => wrong[name]).join("; ");
  }

  async tick(jobs) {
    const own = jobs.find((job) => job.id === this.job);
    if (own?.state === "waiting") this.answer.firstElementChild.textContent = "Waits until the run before it is done.";
    if (own?.state === "running") this.answer.firstElementChild.textContent = "Calibrating …";
    if (this.job === null || own) return;
    const job = this.job;
    this.job = null;
    this.button.textContent = "Calibrate";
    const result = await ask("result", {job});
    if (result.verdict) return this.showResult(result);
    if (result.rows) return this.showList(result);
    this.answer.textContent = result.state === "stopped" ? "Stopped by you." : "No answer.";
    this.mark({"": result.message || ""});
  }

  showResult(facts) {
    const mix = Object.fromEntries(Object.entries(facts.mix).map(([key, value]) => [key, `${Number(value.toPrecision(3))}`]));
    const use = `#slump?${new URLSearchParams(mix)}`;
    this.answer.replaceChildren(h("p.verdict", {"data-part": "constants"}, facts.verdict),
      h("a.button", {href: use, "data-action": "use"}, facts.verdict.startsWith("No mix") ? "Take the nearest mix" : "Take this mix"));
    this.reasons.replaceChildren(h("details", {}, h("summary", {}, "reasons, intervals, each measurement"), h("pre", {}, facts.told)));
    const cone = ["slump_m", "spread_m"].some((key) => facts.measured[key]);
    this.figure.hidden = !cone;
    if (cone) this.draw(facts, mix);
  }

  // The mixes of a list with their constants and reasons, how many there are of each verdict, and the chart.
  showList({rows, verdicts: meanings, csv, chart, message}) {
    const count = new Map(), keys = Object.keys(CONSTANTS).filter((key) => rows.some((row) => range(row, key)));
    for (const {verdict} of rows) count.set(verdict, (count.get(verdict) || 0) + 1);
    const verdicts = [...count].map(([verdict, many]) => `${many} ${verdict}`).join(", ");
    const saved = URL.createObjectURL(new Blob([csv], {type: "text/csv"}));
    this.answer.replaceChildren(h("p.verdict", {"data-part": "verdicts"}, `${rows.length} ${rows.length > 1 ? "mixes" : "mix"}: ${verdicts}.`),
      h("a.button", {href: saved, download: `${this.named}-calibrated.csv`, "data-action": "save-list"}, "Save all results as CSV"));
    const notes = message.split("\n").filter((line) => line.startsWith("table = ")).map((line) => h("p", {}, told("table", line)));
    const name = Object.keys(rows[0])[0];
    const lines = rows.slice(0, MOST_ROWS).map((row) => [row[name] ?? "", row.verdict, ...keys.map((key) => range(row, key)), row.reason]);
    const rest = rows.length > MOST_ROWS ? h("p", {}, `and ${rows.length - MOST_ROWS} more, in the CSV`) : "";
    this.reasons.replaceChildren(
      h("div.wide", {"data-part": "list", tabindex: "0"}, table([name, "verdict", ...keys.map((key) => CONSTANTS[key]), "reason"], lines)), rest,
      h("details", {}, h("summary", {}, "what the verdicts mean"), h("dl", {}, [...count.keys()].map((verdict) => [h("dt", {}, verdict), h("dd", {}, meanings[verdict])]))), ...notes,
      chart && h("img.film", {src: `data:image/png;base64,${chart}`, alt: "slump flow against slump, each mix joined with the nearest of the model", "data-part": "list-chart"}));
  }

  // The cone of the model, and what was measured over it.
  async draw(facts, mix) {
    this.stage.marks = {slump_m: facts.measured.slump_m?.[0], spread_m: facts.measured.spread_m?.[0]};
    try {
      for await (const part of listen("preview", {test: "slump", values: mix})) {
        if (part.stage) this.stage.begin(part.stage);
        if (part.t !== undefined) this.stage.add(part);
        if (part.result) this.stage.finish(part.result.time);
      }
    } catch {
      this.figure.hidden = true;
    }
  }
}

// A constant of a row of results with its 95 % interval, or its limit.
function range(row, key) {
  const [found, low, high] = ["found", "lower", "upper"].map((end) => row[`${key}_${end}`] == null ? null : Number(row[`${key}_${end}`].toPrecision(3)));
  if (found !== null) return low !== null && high !== null && low < high ? `${found} (${low} to ${high})` : `${found}`;
  if (low !== null && high !== null) return `${low} to ${high}`;
  return low !== null ? `over ${low}` : high !== null ? `below ${high}` : "";
}
