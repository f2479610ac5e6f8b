// The section of the concrete as it sinks: particles as one smooth body, ruler and dimensions on the plane of the
// section, the mould dashed. A finger, a mouse or the arrow keys read the height.

const REACH = 3; // of a particle's weight over the spacing; with less rows of particles show
const PEAK = 31; // of its weight, in levels of 255
const AXIS = 0.4; // of the radius of the mould's top: how far from the axis the slump is read
const LONGEST = 4; // [s] that a film takes; a longer one is shown faster, and says so

function weight(q) {
  return q < 1 ? (1 - q * q) ** 2 : 0;
}

// Level of the weights half a size beyond the last row of a lattice, which is where the body ends.
const LEVEL = (() => {
  let sum = 0;
  for (const aside of [0, 0.25, 0.5])
    for (let row = 0; row < 4; row++)
      for (let k = -4; k <= 4; k++) sum += weight(Math.hypot(k + aside, row + 0.5) / REACH);
  return (PEAK * sum) / 3;
})();

function spot() {
  const made = document.createElement("canvas"), size = 64;
  made.width = made.height = size;
  const context = made.getContext("2d"), image = context.createImageData(size, size);
  for (let k = 0; k < size * size; k++) {
    const q = Math.hypot((k % size) + 0.5 - size / 2, Math.floor(k / size) + 0.5 - size / 2) / (size / 2);
    image.data[4 * k + 3] = PEAK * weight(q);
  }
  context.putImageData(image, 0, 0);
  return made;
}

export class Stage {
  constructor(canvas, caption, again) {
    Object.assign(this, {canvas, caption, again, frames: [], film: 0, wide: 0, marks: null, at: null, shown: null});
    this.context = canvas.getContext("2d");
    this.mask = document.createElement("canvas");
    this.spot = spot();
    this.still = matchMedia("(prefers-reduced-motion: reduce)");
    again?.addEventListener("click", () => this.play());
    const read = (event) => this.read(event.clientX - canvas.getBoundingClientRect().left);
    canvas.addEventListener("pointermove", read);
    canvas.addEventListener("pointerdown", read);
    canvas.addEventListener("pointerleave", () => this.read(null));
    canvas.addEventListener("blur", () => this.read(null));
    canvas.addEventListener("keydown", (event) => {
      const step = {ArrowLeft: -8, ArrowRight: 8}[event.key];
      if (step) this.read((this.at ?? canvas.clientWidth / 2) + step), event.preventDefault();
    });
    new ResizeObserver(() => this.request()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.request());
  }

  begin(scene) {
    this.scene = scene;
    this.frames = [];
    this.end = null;
    this.film = this.played = 0;
    this.seen = performance.now();
  }

  clear() {
    this.frames = [];
    this.caption.textContent = "";
    this.again.hidden = true;
    this.request();
  }

  add({t, m, x}) {
    const bytes = Uint8Array.from(atob(x), (c) => c.charCodeAt(0));
    this.frames.push({t, m, x: new Int16Array(bytes.buffer)});
    this.request();
  }

  finish(time) {
    this.end = time;
    if (this.still.matches) this.film = time;
    this.request();
  }

  play() {
    this.film = this.played = 0;
    this.seen = performance.now();
    this.request();
  }

  read(x) {
    this.at = x;
    this.request();
  }

  request() {
    this.due ??= requestAnimationFrame((now) => {
      this.due = null;
      this.move(now);
      this.draw();
    });
  }

  // Move the film on, in real time, or faster where it would take too long.
  move(now) {
    const last = this.frames.at(-1);
    if (!last) return;
    const passed = Math.min(0.1, Math.max(0, (now - this.seen) / 1000));
    const left = (this.end ?? 0) - this.film;
    this.speed = Math.max(1, left / Math.max(0.5, LONGEST - this.played));
    this.seen = now;
    this.played += passed;
    this.film = Math.min(last.t, this.film + passed * this.speed);
    if (this.film < last.t) this.request();
    const over = this.end !== null && this.film >= last.t;
    if (this.caption) {
      const pace = over ? "at rest" : this.speed > 1.05 ? `${Number(this.speed.toPrecision(2))}x speed` : "real time";
      this.caption.textContent = `${this.film.toFixed(2)} s, ${this.resting === false && over ? "end" : pace}`;
    }
    if (this.again) this.again.hidden = !over;
  }

  // The frame at the time of the film, between two that were computed.
  now() {
    const k = this.frames.findLastIndex((frame) => frame.t <= this.film);
    const [a, b] = [this.frames[Math.max(0, k)], this.frames[k + 1]];
    if (!b || b.x.length !== a.x.length) return a;
    const part = (this.film - a.t) / (b.t - a.t), {scene} = this;
    const round = scene.periodic ? (scene.high[0] - scene.low[0]) / scene.unit : Infinity;  // the nearer way across the period
    const way = (from, to, along) => to - from - (along && round < Infinity ? round * Math.round((to - from) / round) : 0);
    return {m: part < 0.5 ? a.m : b.m, x: Float32Array.from(a.x, (value, j) => value + part * way(value, b.x[j], j % 3 === 0))};
  }

  draw() {
    const {canvas, context, scene} = this;
    const ratio = devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight;
    if (!w || !h) return;
    if (canvas.width !== Math.round(w * ratio) || canvas.height !== Math.round(h * ratio)) {
      canvas.width = Math.round(w * ratio);
      canvas.height = Math.round(h * ratio);
    }
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, w, h);
    if (!this.frames.length) return;
    const style = getComputedStyle(canvas);
    const ink = style.getPropertyValue("--ink"), soft = style.getPropertyValue("--soft"), accent = style.getPropertyValue("--accent");
    const frame = this.now();
    this.place(frame, w, h);
    this.body(frame, w, h, style.getPropertyValue("--concrete").split(",").map(Number));
    context.save();
    context.translate(w / 2, h / 2);
    context.rotate((scene.tilt * Math.PI) / 180);
    if (scene.tilt) context.scale(1.2, 1.2); // its ends beyond those of the canvas
    context.translate(-w / 2, -h / 2);
    this.stretch = this.stretched(frame.m);
    context.drawImage(this.mask, this.zero * (1 - this.stretch), 0, this.stretch * w, h);
    if (scene.periodic) this.dye(frame, ink);
    context.restore();
    context.font = `13px ${style.fontFamily}`;
    context.lineWidth = 1;
    if (!scene.periodic) this.ruler(w, ink, soft);
    if (scene.mould.length) {
      context.strokeStyle = soft;
      context.setLineDash([5, 4]);
      this.path([scene.mould[0][0], scene.mould[0].at(-1), scene.mould[1].at(-1), scene.mould[1][0]]);
      context.setLineDash([]);
    }
    context.strokeStyle = ink;
    for (const wall of scene.walls) this.path(wall);
    this.dimensions(frame.m, ink);
    if (this.marks) this.measured(this.marks, accent);
    if (this.at !== null) this.height(w, h, accent);
  }

  // Where metres lie on the canvas: the whole of what moves, never jumping.
  place(frame, w, h) {
    const {scene} = this;
    const tall = scene.rings ? scene.height : this.tall();
    let left = 0, right;
    if (scene.rings) {
      const flow = Math.max(this.marks?.spread_m || 0, frame.m.spread_m?.[0] || 0);
      const wanted = Math.max(0.85 * tall, 0.6 * flow);
      const fits = wanted <= this.wide && this.wide < 2.2 * wanted;
      this.wide = fits ? this.wide : this.wide && wanted > this.wide ? this.wide + 0.3 * (wanted - this.wide) : wanted;
      [left, right] = [-this.wide, this.wide];
    } else [left, right] = [Math.max(0, scene.low[0]), scene.high[0]];
    this.scale = Math.min((w - 24) / (right - left), ((scene.periodic ? 0.5 : 1) * (h - 84)) / tall);
    this.zero = w / 2 - (0.5 * (left + right)) * this.scale;
    this.ground = scene.periodic ? 0.75 * h : h - 44;
  }

  // The row of particles that stood upright at first, as if dyed.
  dye(frame, ink) {
    const {context, scene} = this, first = this.frames[0].x, unit = scene.unit * this.scale;
    const long = (scene.high[0] - scene.low[0]) * this.scale, far = Math.ceil(this.canvas.clientWidth / long);
    context.fillStyle = ink;
    for (let k = 0; k < first.length; k += 3)
      if (first[k] * scene.unit < 0.99 * scene.spacing)
        for (let copy = -far; copy <= far; copy++) {
          context.beginPath();
          context.arc(this.zero + frame.x[k] * unit + copy * long, this.ground - frame.x[k + 1] * unit, 0.3 * scene.spacing * this.scale, 0, 7);
          context.fill();
        }
    context.fillRect(-this.canvas.clientWidth, this.ground, 3 * this.canvas.clientWidth, 2);
  }

  tall() {
    const first = this.frames[0].x;
    let top = 0;
    for (let k = 1; k < first.length; k += 3) top = Math.max(top, first[k]);
    return 1.1 * top * this.scene.unit;
  }

  // The particles as one body: weights summed, and what lies above the level is concrete.
  body(frame, w, h, [r, g, b]) {
    const {mask, scene, spot} = this;
    if (mask.width !== w || mask.height !== h) [mask.width, mask.height] = [w, h];
    const context = mask.getContext("2d", {willReadFrequently: true});
    context.globalCompositeOperation = "source-over";
    context.clearRect(0, 0, w, h);
    context.globalCompositeOperation = "lighter";
    const unit = scene.unit * this.scale, wide = scene.spacing * this.scale, reach = REACH * wide, long = (scene.high[0] - scene.low[0]) * this.scale;
    const far = scene.periodic ? Math.ceil(w / long) : 0;
    const places = scene.rings ? [[1, 0], [-1, 0]] : Array.from({length: 2 * far + 1}, (_, k) => [1, (k - far) * long]);
    for (let k = 0; k < frame.x.length; k += 3) {
      const z = frame.x[k + 1] * unit, size = frame.x[k + 2] * unit;
      context.globalAlpha = Math.min(1, (size / wide) ** 2);
      for (const [side, aside] of places) {
        const x = this.zero + side * frame.x[k] * unit + aside - reach;
        context.drawImage(spot, x, this.ground - z - reach, 2 * reach, 2 * reach);
        if (z < reach) context.drawImage(spot, x, this.ground + z - reach, 2 * reach, 2 * reach);
      }
    }
    context.globalAlpha = 1;
    const edge = Math.max(9, 160 / wide);  // levels over a pixel and a half
    const image = context.getImageData(0, 0, w, h), data = image.data, floor = Math.min(h, Math.round(this.ground));
    this.tops = new Float32Array(w).fill(NaN);
    for (let y = h - 1; y >= 0; y--)
      for (let x = 0; x < w; x++) {
        const k = 4 * (y * w + x), level = data[k + 3];
        if (y >= floor || level < LEVEL - edge / 2) data[k + 3] = 0;
        else {
          const light = 0.84 + 0.16 * Math.min(1, (level - LEVEL) / 45);
          data[k] = r * light;
          data[k + 1] = g * light;
          data[k + 2] = b * light;
          data[k + 3] = Math.min(255, Math.max(0, ((level - LEVEL) / edge + 0.5) * 255));
          if (level >= LEVEL) this.tops[x] = this.ground - y;
        }
      }
    if (scene.rings && scene.mould.length) this.atAxis(data, w, h);
    context.putImageData(image, 0, 0);
  }

  // The measured radius of a heap over that of its body, of which smoothing takes off the thin rim.
  stretched({spread_m: flow}) {
    const far = this.tops.findLastIndex((top) => top > 0) - this.zero;
    return this.scene.rings && flow?.[0] && far > 0 ? Math.max(1, Math.min(1.1, (0.5 * flow[0] * this.scale) / far)) : 1;
  }

  // The top of a heap, level where its slump is read: rings leave a hole at the axis.
  atAxis(data, w, h) {
    const near = AXIS * Math.abs(this.scene.mould[0].at(-1)[0]) * this.scale, columns = [];
    for (let x = Math.max(0, Math.ceil(this.zero - near)); x < Math.min(w, this.zero + near); x++) columns.push(x);
    const high = columns.reduce((best, x) => (this.tops[x] > this.tops[best] ? x : best), columns[0]);
    for (const x of columns) {
      this.tops[x] = this.tops[high];
      for (let k = 4 * x; k < data.length; k += 4 * w) data.copyWithin(k, k + 4 * (high - x), k + 4 * (high - x) + 4);
    }
  }

  path(points) {
    this.context.beginPath();
    for (const [x, z] of points) this.context.lineTo(this.zero + x * this.scale, this.ground - z * this.scale);
    this.context.stroke();
  }

  text(words, x, y, colour, align = "center") {
    const {context} = this, wide = context.measureText(words).width + 8;
    context.textAlign = align;
    context.fillStyle = getComputedStyle(this.canvas).getPropertyValue("--paper");
    context.globalAlpha = 0.85;
    context.fillRect(x - {left: 4, center: wide / 2, right: wide - 4}[align], y - 12, wide, 16);
    context.globalAlpha = 1;
    context.fillStyle = colour;
    context.fillText(words, x, y);
  }

  // The floor with a tick each 5 or 10 cm, which lies in the plane of the section.
  ruler(w, ink, soft) {
    const {context, ground, zero, scale} = this;
    context.strokeStyle = ink;
    context.beginPath();
    context.moveTo(8, ground + 0.5);
    context.lineTo(w - 8, ground + 0.5);
    const step = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5].find((size) => size * scale >= 28) || 1;
    for (let k = Math.ceil((8 - zero) / scale / step); zero + k * step * scale < w - 8; k++) {
      const x = zero + k * step * scale;
      context.moveTo(x, ground);
      context.lineTo(x, ground + 5);
    }
    context.stroke();
    const from = this.scene.rings ? 0 : Math.ceil((8 - zero) / scale / step);
    for (let k = from; zero + k * step * scale < w - 46; k += 2)
      if (k) this.text(`${Math.round(100 * k * step)}`, zero + k * step * scale, ground + 17, soft);
    this.text("cm", w - 10, ground + 17, soft, "right");
  }

  arrow(x1, y1, x2, y2) {
    const {context} = this, angle = Math.atan2(y2 - y1, x2 - x1);
    context.beginPath();
    context.moveTo(x1, y1);
    context.lineTo(x2, y2);
    for (const [x, y, turn] of [[x1, y1, 0], [x2, y2, Math.PI]])
      for (const side of [0.4, -0.4]) {
        context.moveTo(x, y);
        context.lineTo(x + 7 * Math.cos(angle + turn + side), y + 7 * Math.sin(angle + turn + side));
      }
    context.stroke();
  }

  // What is measured, drawn on the body.
  dimensions(m, ink) {
    const {context, zero, scale, ground, scene} = this;
    context.strokeStyle = ink;
    const [flow, slump, front] = [m.spread_m, m.slump_m, m.front_m];
    if (flow?.[0]) {
      const half = 0.5 * flow[0] * scale, y = ground + 30;
      this.arrow(zero - half, y, zero + half, y);
      this.text(flow[1], zero, y + 5, ink);
    }
    if (slump && scene.height && slump[0] * scale > 4) {
      const top = ground - scene.height * scale;
      context.strokeStyle = ink;
      this.arrow(zero, top, zero, top + slump[0] * scale);
      this.text(slump[1], zero + 8, top + 0.5 * slump[0] * scale + 4, ink, "left");
    }
    if (front?.[0]) {
      this.arrow(zero, ground + 30, zero + front[0] * scale, ground + 30);
      this.text(front[1], zero + 0.5 * front[0] * scale, ground + 35, ink);
    }
  }

  // What somebody has measured [m], over the body.
  measured({slump_m, spread_m}, accent) {
    const {context, zero, scale, ground, scene} = this;
    context.strokeStyle = accent;
    context.setLineDash([2, 3]);
    context.lineWidth = 2;
    const half = 0.5 * (spread_m || 0.6 * scene.height), top = scene.height - (slump_m || 0);
    if (slump_m) this.path([[-half, top], [half, top]]);
    for (const side of spread_m ? [-1, 1] : []) this.path([[side * half, 0], [side * half, slump_m ? top : 0.15 * scene.height]]);
    context.setLineDash([]);
    context.lineWidth = 1;
    this.text("measured", zero + half * scale + 6, ground - (slump_m ? top : 0.15 * scene.height) * scale + 4, accent, "left");
  }

  height(w, h, accent) {
    const x = Math.max(0, Math.min(w - 1, Math.round(this.at))), top = this.tops[Math.round(this.zero + (x - this.zero) / this.stretch)];
    const {context, ground} = this, place = Math.abs(x - this.zero) / this.scale;
    context.strokeStyle = accent;
    context.beginPath();
    context.moveTo(x + 0.5, ground);
    context.lineTo(x + 0.5, ground - (top || 0));
    context.stroke();
    const words = Number.isNaN(top) ? "nothing here" : `${((100 * top) / this.scale).toFixed(1)} cm high`;
    const where = `${(100 * place).toFixed(1)} cm from the ${this.scene.rings ? "axis" : "wall"}`;
    this.text(`${words}, ${where}`, Math.max(110, Math.min(w - 110, x)), Math.max(16, ground - (top || 0) - 10), accent);
  }
}
