// The lit body of a report on the stage: of a run as it moves, or of what is about to flow in its vessel. Drawn by
// viewer.js and film.js of a report.

const HOLD = 1.5; // [s] that the end of a film stays
const DATA = /<script type="application\/json" id="data">(.*?)<\/script>/s;

export class Body {
  constructor(stage, canvas, over, caption) {
    Object.assign(this, {stage, canvas, over, caption, data: null, meshes: [], grains: []});
    this.dark = matchMedia("(prefers-color-scheme: dark)");
    this.still = matchMedia("(prefers-reduced-motion: reduce)");
    this.dark.addEventListener("change", () => this.draw());
    new ResizeObserver(() => this.draw()).observe(canvas);
    dragged(canvas, (across, up) => this.turn(across, up));
    canvas.addEventListener("keydown", (event) => {
      const way = {ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.08], ArrowDown: [0, -0.08]}[event.key];
      if (way) this.turn(...way), event.preventDefault();
    });
  }

  hide() {
    this.data = this.asked = null;
    cancelAnimationFrame(this.due);
    delete this.stage.dataset.body;
  }

  // The film of the report at an address; what it holds was written by anybody, and is read as data alone.
  async report(address) {
    this.asked = address;
    const found = DATA.exec(await (await fetch(address)).text().catch(() => ""));
    if (found && this.asked === address) await this.show(JSON.parse(found[1]));
  }

  // Data as of a report; ``words`` stand in place of its time. Where a browser shows none the stage stays as it was.
  async show(data, words = "") {
    this.data = data;
    cancelAnimationFrame(this.due);  // of the film before
    try {
      const meshes = await decoded(data.film), grains = await decodedGrains(data.film), again = words && this.words;
      if (this.data !== data) return;  // a later one has come
      this.stage.dataset.body = "";
      const {turn, tilt} = this.viewer || {};
      if (this.viewer) this.viewer.fit(...fitting(data));
      else this.viewer = new Viewer(this.canvas, ...fitting(data));
      if (again && !this.viewer.flat && tilt) Object.assign(this.viewer, {turn, tilt});  // as the user has turned it
      for (const {card} of [...this.meshes, ...this.grains])
        for (const key of ["at", "normal", "shade", "rows", "tone", "radius"]) if (card?.[key]) this.viewer.gl.deleteBuffer(card[key]);
      Object.assign(this, {meshes, grains, words, picture: this.still.matches ? meshes.length - 1 : 0});
      this.draw();
      if (meshes.length > 1 && !this.still.matches) this.play();
    } catch {
      if (this.data === data) this.hide();  // no WebGL
    }
  }

  play() {
    const {film} = this.data, [speed] = pace(film), last = film.times.length - 1;
    let begun = performance.now();
    const step = (now) => {
      const time = film.times[0] + ((now - begun) / 1000) * speed;
      if (time > film.times[last] + HOLD * speed) begun = now;
      const next = Math.max(0, film.times.findLastIndex((each) => each <= time));
      if (next !== this.picture) this.picture = next, this.draw();
      this.due = requestAnimationFrame(step);
    };
    cancelAnimationFrame(this.due);
    this.due = requestAnimationFrame(step);
  }

  turn(across, up) {
    if (!this.data || this.viewer.flat) return;
    this.viewer.turn += across;
    this.viewer.tilt = Math.min(1.5, Math.max(0.02, this.viewer.tilt + up));
    this.draw();
  }

  draw() {
    if (!this.data || !this.meshes.length || !this.canvas.clientWidth || !("body" in this.stage.dataset)) return;
    const {data, viewer, picture} = this, {film} = data;
    const made = film.grains && this.grains[picture], grains = made ? grainsOnCard(viewer, made, film.grains) : null;
    viewer.draw(onCard(viewer, this.meshes[picture]), {mode: 0, grains, ...around(data, this.dark.matches)});
    this.over.replaceChildren(...film.dimensions[picture].flatMap((each) => dimension(viewer, each)));
    this.caption.textContent = this.words || `${film.times[picture].toFixed(2)} s, ${pace(film)[1]}`;
  }
}
