// The mix of measured tests: the answer first, then one picture, then the reasons.

import {ask, h, listen, question, told, unitOf} from "./ask.js";
import {Stage} from "./stage.js";

const FIRST = ["slump", "spread", "t500", "mini_cone", "v_funnel"];
const FIRST_WORDS = "Results appear here.";

export class Calibrate {
  constructor(place, measurements, go) {
    Object.assign(this, {measurements, go, values: {}, job: null, state: null});
    this.inputs = {};
    const control = (field) => {
      const id = `measured-${field.name}`;
      const shown = {id, "data-field": `calibrate-${field.name}`, placeholder: field.usual || "–", "aria-describedby": `${id}-wrong`};
      this.inputs[field.name] = h("input", {...shown, inputmode: "decimal", oninput: (event) => this.set(field.name, event.target.value)});
      return h("div.field", {title: field.help}, h("label", {for: id}, field.label), this.inputs[field.name],
        h("span.unit", {}, unitOf(field, "")), h("p.wrong", {id: `${id}-wrong`}), h("p.asked"));
    };
    const [first, others] = [measurements.filter((it) => FIRST.includes(it.name)), measurements.filter((it) => !FIRST.includes(it.name))];
    this.check = h("input", {type: "checkbox", checked: true, id: "finer"});
    this.button = h("button", {type: "submit", "data-action": "calibrate"}, "Calibrate");
    this.wrong = h("p.wrong", {role: "alert"});
    this.canvas = h("canvas", {"aria-label": "the measured cone over that of the model", role: "img"});
    this.answer = h("div.answer", {"data-part": "answer", "aria-live": "polite"});
    this.figure = h("figure.compared", {hidden: true}, this.canvas);
    this.reasons = h("div");
    place.append(
      h("form", {autocomplete: "off", onsubmit: (event) => this.press(event)},
        h("h1", {}, "Which mix is it? Give what was measured, one test or more."),
        first.map(control),
        h("details", {}, h("summary", {}, "density, rheometer, errors of the measurements"), others.map(control)),
        h("label.tick", {for: "finer"}, this.check, "check by one finer run, some 20 s"),
        this.wrong, this.button),
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
    row.querySelector(".unit").textContent = unitOf(field, text);
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
    this.mark({});
    this.answer.replaceChildren(h("p", {}, "Calibrating …"), h("progress"));
    this.figure.hidden = this.button.disabled = true;
    this.reasons.replaceChildren();
    const answer = await ask("calibrate", {values: this.values, check: this.check.checked});
    this.button.disabled = false;
    if (answer.wrong) {
      this.answer.textContent = FIRST_WORDS;
      return this.mark(answer.wrong);
    }
    this.job = answer.job;
    this.button.textContent = "Stop";
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
    if (this.job === null || jobs.some((job) => job.id === this.job)) return;
    const job = this.job;
    this.job = null;
    this.button.textContent = "Calibrate";
    const result = await ask("result", {job});
    if (result.verdict) return this.showResult(result);
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
