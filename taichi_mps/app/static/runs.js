// Runs of the folder, newest first: look, compare, resume, rename, delete into a bin.

import {ask, h, reason} from "./ask.js";

function size(bytes) {
  return bytes < 1e6 ? `${Math.ceil(bytes / 1e3)} kB` : `${Number((bytes / 1e6).toPrecision(2))} MB`;
}

export function table(head, lines) {
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
      h("div.found", {}, h("b", {}, run.verdict || run.result || ""),
        run.verdict && h("p", {}, run.result), h("p", {}, run.runs ? "running" : run.end)),
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
    files.push(h("button.quiet", {type: "button", "data-action": "csv", onclick: () => save(`${run.name}-results`, results(run.table))}, "save results as CSV"));
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
      drawn(facts.curves));
  }
}

// A chart of each result that the runs have, a curve for each run.
function drawn(runs) {
  const place = h("div", {"data-part": "curves"}), charts = new Map();
  for (const {name, charts: own} of runs)
    for (const {unit, curves} of own)
      for (const curve of curves) {
        const key = `${curve.name} ${unit}`;
        if (!charts.has(key)) charts.set(key, {unit, title: `${curve.name}${unit ? ` [${unit}]` : ""}`, legend: false, curves: []});
        charts.get(key).curves.push({...curve, name});
      }
  for (const each of charts.values()) chart(each, place);  // charts.js, as in a report
  const legend = runs.map(({name}, k) => h("span", {}, h("i.line", {"data-colour": k % COLOURS.length}), name));
  return charts.size ? h("figure", {}, h("figcaption", {}, legend), place) : "";
}
