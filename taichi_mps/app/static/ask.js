// Questions to the server, and elements made in one line.

export async function ask(what, query = {}) {
  let answer;
  try {
    answer = await fetch(`/ask/${what}`, {
      method: "POST", headers: {"Content-Type": "application/json"}, body: JSON.stringify(query),
    });
  } catch {
    document.getElementById("lost").hidden = false;
    return {wrong: {"": ""}, lost: true};
  }
  document.getElementById("lost").hidden = true;
  return answer.ok ? answer.json() : {wrong: {"": `The server says ${answer.status}.`}};
}

// A message "key = value: what is wrong" without its beginning, to stand at the field of that key.
export function told(key, text) {
  const rest = text.startsWith(`${key} = `) ? text.slice(text.indexOf(": ") + 2) : text;
  return rest.slice(0, 1).toUpperCase() + rest.slice(1);
}

// All that is wrong with an answer, as one text.
export function reason(answer) {
  return Object.values(answer.wrong || {}).join("; ");
}

// Lines of JSON as they come; stops when the signal is aborted.
export async function* listen(what, query, signal) {
  const answer = await fetch(`/ask/${what}`, {
    method: "POST", headers: {"Content-Type": "application/json"}, body: JSON.stringify(query), signal,
  });
  const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
  let rest = "";
  for (;;) {
    const {value, done} = await reader.read();
    if (done) return;
    const lines = (rest + value).split("\n");
    rest = lines.pop();
    for (const line of lines) yield JSON.parse(line);
  }
}

// An element: h("a.name", {href: "#"}, "text", other)
export function h(kind, given = {}, ...inner) {
  const [tag, ...classes] = kind.split(".");
  const made = document.createElement(tag);
  made.classList.add(...classes);
  for (const [key, value] of Object.entries(given)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (value === true || (value !== false && value !== null && value !== undefined))
      made.setAttribute(key, value === true ? "" : value);
  }
  made.append(...inner.flat().filter((part) => part !== null && part !== undefined && part !== false && part !== ""));
  return made;
}

export function icon(name) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  const use = document.createElementNS("http://www.w3.org/2000/svg", "use");
  use.setAttribute("href", `#${document.getElementById(name)?.tagName === "symbol" ? name : "test"}`);
  svg.setAttribute("aria-hidden", "true");
  svg.setAttribute("class", "icon");
  svg.append(use);
  return svg;
}

export const by = (id) => document.getElementById(id);

export function inTime(seconds) {
  for (const [unit, size] of [["h", 3600], ["min", 60]])
    if (seconds >= 1.5 * size) return `${Number((seconds / size).toPrecision(2))} ${unit}`;
  return `${Math.max(1, Number(seconds.toPrecision(2)))} s`;
}

// Sizes of the units in which people think of lengths, flow rates and ages, by the unit of the field.
const THOUGHT = {m: {mm: 1e-3, cm: 1e-2}, "m3/s": {"l/min": 1 / 6e4}, age: {min: 60}};

// The usual text of a field, with a unit of its own where people think in another than that of the field.
export function usual(field) {
  return field.name in THOUGHT && field.usual ? `${field.usual} ${Object.keys(THOUGHT[field.name])[0]}` : field.usual;
}

// The unit in which a text of a field is taken: none beside one that has its own.
export function unitOf(field, text) {
  const shown = text.trim() || usual(field);
  return /^[-+\d.,\s]*$/.test(shown) ? field.unit : "";
}

// A number without a unit that is far too large in the unit of its field, as it was meant: "18 cm", in the unit that comes
// nearest to the default; an age alone is always asked. Or "".
export function meant(field, text) {
  const number = Number(text.replace(",", ".")), sizes = THOUGHT[field.name] || THOUGHT[field.unit];
  const standard = field.default || {m: 0.15, "m3/s": 0.012}[field.unit] || 0;
  if (!sizes || !text.trim() || !(number > 0 && number >= 20 * standard)) return "";
  const off = (unit) => Math.abs(Math.log((number * sizes[unit]) / (standard || 1)));
  return `${number} ${Object.keys(sizes).reduce((best, unit) => (off(unit) < off(best) ? unit : best))}`;
}

// The question for what was meant, as a button below a field; ``take`` gets the text with its unit.
export function question(field, text, place, take) {
  const words = meant(field, text);
  place.replaceChildren(words && h("button.quiet", {type: "button", onclick: () => take(words)}, `${words}?`));
}

// Class of a slump or a slump flow [m] by EN 206, which is read to the nearest 10 mm.
export function en206(key, value) {
  const read = 10 * Math.round(100 * value);
  const classes = {
    slump_m: [["S1", 10, 40], ["S2", 50, 90], ["S3", 100, 150], ["S4", 160, 210], ["S5", 220, Infinity]],
    spread_m: [["SF1", 550, 650], ["SF2", 660, 750], ["SF3", 760, 850]],
  }[key] || [];
  return classes.find(([, low, high]) => low <= read && read <= high)?.[0] || "";
}
