// Runs of the folder, newest first: look, compare, resume, rename, delete into a bin.

import {ask, h, reason} from "./ask.js";

const COLOURS = ["#1f77b4", "#d1611c", "#2a8f4d", "#8a4fb5", "#8c6d31", "#c2395b"];

function size(bytes) {
  return bytes < 1e6 ? `${Math.ceil(bytes / 1e3)} kB` : `${Number((bytes / 1e6).toPrecision(2))} MB`;
}

function table(head, lines) {
  const row = (kind, cells) => h("tr", {}, cells.map((cell, k) => h(k && kind === "td" ? "td" : "th", {scope: kind === "th" ? "col" : "row"}, cell)));
  return h("table", {}, head.length ? h("thead", {}, row("th", head)) : "", h("tbody", {}, lines.map((line) => row("td", line))));
}

export class Runs {
  constructor(place, go) {
    Object.assign(this, {place, go, rows: [], chosen: new Set(), known: ""});
    this.notice = h("p.notice", {role: "alert", hidden: true});
    this.bar = h("div.actions");
    this.list = h("div.rows", {"data-part": "runs"});
    this.bin = h("details.bin", {hidden: true});
    this.detail = h("article", {"data-part": "run"});
    place.append(this.notice, h("h1", {}, "Runs"), this.bar, this.list, this.bin, this.detail);
  }

  say(words) {
    this.notice.hidden = !words;
    this.notice.textContent = words || "";
  }

  // What the address asks for: the list, one run, or a comparison of several.
  async show(page, name, names) {
    this.page = page;
    this.name = name;
    if (page === "compare") this.chosen = new Set(names);
    const alone = page === "compare" || name;
    this.place.dataset.view = alone ? "one" : "list";
    this.detail.replaceChildren();
    this.say("");
    this.actions();
    await this.fill();
    if (page === "compare") this.compare([...this.chosen]);
    else if (name) this.open(name);
  }

  async tick(jobs) {
    if (this.place.hidden) return;
    const known = JSON.stringify(jobs.map(({id, state}) => [id, state]));
    if (known === this.known && !jobs.some((job) => job.state === "running")) return;
    const ended = known !== this.known;
    this.known = known;
    await this.fill();
    if (this.page === "compare" && ended) this.compare([...this.chosen]);
  }

  async fill() {
    const {runs = [], bin = []} = await ask("list");
    const known = JSON.stringify([runs, bin]);
    if (known === this.drawn) return;
    this.drawn = known;
    this.rows = runs;
    for (const name of this.chosen) if (!runs.some((run) => run.name === name)) this.chosen.delete(name);
    this.list.replaceChildren(...runs.map((run) => this.row(run)));
    if (!runs.length) this.list.append(h("p", {}, "No runs yet: choose a test and press Run."));
    this.bin.hidden = !bin.length;
    const restore = (name) => h("button.quiet", {type: "button", onclick: () => this.change("restore", {names: [name]})}, "put back");
    const empty = () => confirm(`Remove ${bin.length} run${bin.length > 1 ? "s" : ""} for good?`) && this.change("empty", {});
    this.bin.replaceChildren(h("summary", {}, `Bin (${bin.length})`),
      ...bin.map((run) => h("p", {}, `${run.name}, ${size(run.size)} `, restore(run.name))),
      h("button", {type: "button", "data-action": "empty", onclick: empty}, "Empty the bin"));
    this.actions();
  }

  row(run) {
    const pick = h("input", {type: "checkbox", checked: this.chosen.has(run.name), "aria-label": `choose ${run.name}`});
    pick.addEventListener("change", () => {
      this.chosen[pick.checked ? "add" : "delete"](run.name);
      this.actions();
    });
    const open = `#runs/${encodeURIComponent(run.name)}`;
    const date = run.date ? new Date(run.date).toLocaleString([], {dateStyle: "medium", timeStyle: "short"}) : "";
    return h("div.row", {"data-run": run.name}, pick,
      run.picture ? h("img", {src: run.picture, alt: "", loading: "lazy"}) : h("span.none"),
      h("div.what", {}, h("a", {href: open}, run.name),
        h("p", {}, run.test ? `${run.test}, ${run.mix}` : "")),
      h("div.found", {}, h("b", {}, run.result || ""), h("p", {}, run.runs ? "running" : run.end)),
      h("div.when", {}, date, h("p", {}, size(run.size))),
      h("div.do", {}, run.report && h("a.button", {href: run.report, target: "_blank", rel: "noopener"}, "report"),
        run.resumable && h("button", {type: "button", "data-action": "resume", onclick: () => this.change("resume", {names: [run.name]})}, "resume"),
        h("button.quiet", {type: "button", "data-action": "rename", onclick: () => this.rename(run)}, "rename"),
        h("button.quiet", {type: "button", "data-action": "delete", onclick: () => this.remove([run.name])}, "delete")));
  }

  actions() {
    const names = [...this.chosen], several = names.length > 1;
    const query = names.map((name) => `run=${encodeURIComponent(name)}`).join("&");
    if (this.place.dataset.view === "one") return this.bar.replaceChildren(h("a.button", {href: "#runs"}, "all runs"));
    this.bar.replaceChildren(
      h("button", {type: "button", disabled: !several, "data-action": "compare", onclick: () => this.go(`#compare?${query}`)}, "Compare"),
      h("button.quiet", {type: "button", disabled: !names.length, onclick: () => this.remove(names)}, "Delete chosen"),
      h("span", {}, names.length ? `${names.length} chosen` : "Choose two or more to compare them."));
  }

  async change(what, query) {
    const answer = await ask(what, query);
    this.say(reason(answer));
    await this.fill();
    return !answer.wrong;
  }

  rename(run) {
    const to = prompt("New name of this run", run.name);
    if (to !== null && to !== run.name) this.change("rename", {names: [run.name], to});
  }

  async remove(names) {
    const which = names.length > 1 ? `${names.length} runs` : names[0];
    if (confirm(`Put ${which} into the bin?`) && (await this.change("delete", {names}))) this.go("#runs");
  }

  async open(name) {
    const run = await ask("show", {names: [name]});
    if (run.wrong) return this.say(reason(run));
    const files = run.files.map(([words, at]) => h("a", {href: at, download: "", "data-file": words}, `save ${words}`));
    this.detail.replaceChildren(
      h("h2", {}, run.name),
      h("div.sentences", {"data-part": "sentences"}, run.sentences.map((text) => h("p", {}, text))),
      h("p.files", {}, run.report ? h("a.button", {href: run.report, target: "_blank", rel: "noopener"}, "open the report") : "", files),
      run.film ? h("img.film", {src: run.film, alt: run.name}) : "",
      run.table.length ? table(["result", "", "what it is"], run.table) : "");
  }

  async compare(names) {
    const facts = await ask("compare", {names});
    if (facts.wrong) return this.say(reason(facts));
    this.detail.replaceChildren(
      h("h2", {}, "Comparison"),
      facts.head.length ? table(["", ...facts.head], facts.lines) : h("p", {}, "None of them has a result."),
      facts.curves.length ? h("figure", {"data-part": "curves"}, ...chart(facts.curves)) : "");
  }
}

// Slump curves in one chart.
function chart(curves) {
  const w = 720, tall = 300, left = 46, bottom = 34, ns = "http://www.w3.org/2000/svg";
  const right = Math.max(...curves.map(({points}) => points.at(-1)[0])), top = 1.05 * Math.max(1, ...curves.flatMap(({points}) => points.map(([, y]) => y)));
  const x = (t) => left + ((w - left - 10) * t) / right, y = (v) => tall - bottom - ((tall - bottom - 10) * v) / top;
  const make = (tag, given, text = "") => {
    const made = document.createElementNS(ns, tag);
    for (const [key, value] of Object.entries(given)) made.setAttribute(key, value);
    made.textContent = text;
    return made;
  };
  const svg = make("svg", {viewBox: `0 0 ${w} ${tall}`, class: "chart", role: "img", "aria-label": "slump over time"});
  for (let k = 0; k <= 4; k++) {
    svg.append(make("line", {x1: left, x2: w - 10, y1: y((top * k) / 4), y2: y((top * k) / 4), class: "grid"}));
    svg.append(make("text", {x: left - 6, y: y((top * k) / 4) + 4, "text-anchor": "end"}, ((top * k) / 4).toFixed(1)));
    svg.append(make("text", {x: x((right * k) / 4), y: tall - bottom + 16, "text-anchor": "middle"}, ((right * k) / 4).toPrecision(2)));
  }
  svg.append(make("text", {x: left + 4, y: 12}, "slump [cm]"), make("text", {x: w - 10, y: tall - 4, "text-anchor": "end"}, "time [s]"));
  curves.forEach(({points}, k) => svg.append(make("polyline", {points: points.map(([t, v]) => `${x(t)},${y(v)}`).join(" "), fill: "none", stroke: COLOURS[k % 6], "stroke-width": 2})));
  const legend = curves.map(({name}, k) => {
    const mark = h("i.line");
    mark.style.background = COLOURS[k % 6];
    return h("span", {}, mark, name);
  });
  return [svg, h("figcaption", {}, legend)];
}
