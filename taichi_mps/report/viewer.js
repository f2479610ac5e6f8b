"use strict";
/* A lit body, its shadow on the floor, and glass around it, by WebGL 2. Coordinates [m], z up. */
const LIGHT = `vec3 light(vec3 base, vec3 m, vec3 to, vec3 sun) {
    float shine = (0.5 + 0.16 * m.z) * (0.66 + 0.34 * max(0.0, dot(m, to))) + 0.62 * max(0.0, dot(m, sun));
    return base * shine + 0.10 * pow(max(0.0, dot(m, normalize(to + sun))), 24.0); }`;
const SHADERS = {
  lit: [`in vec3 at, normal; in float shade; uniform mat4 view; uniform vec3 sun; uniform float flat_on, size;
    out vec3 n, place; out float s;
    void main() { n = normal; place = at; s = shade; vec3 p = at;
      if (flat_on > -1e8) p = vec3(at.xy - sun.xy / sun.z * (at.z - flat_on), flat_on);
      gl_Position = view * vec4(p, 1.0); gl_PointSize = size / gl_Position.w; }`,
  `in vec3 n, place; in float s; uniform vec3 eye, sun, tone; uniform float mode, dots, cut, cover; uniform vec4 paint; out vec4 colour;
    uniform vec3 ramp[9];
    ${LIGHT}
    void main() {
      if (place.y < cut) discard;
      if (dots > 0.5 && length(gl_PointCoord - 0.5) > 0.5) discard;
      if (paint.a > 0.0) { colour = vec4(paint.rgb * paint.a, paint.a); return; }
      float speed = mod(s * 255.0, 128.0) / 127.0 * 8.0;
      vec3 base = tone;
      if (mode > 1.5) base = s > 0.5 ? vec3(0.93, 0.50, 0.16) : vec3(0.45, 0.53, 0.64);
      else if (mode > 0.5) base = mix(ramp[int(min(speed, 7.0))], ramp[int(min(speed, 7.0)) + 1], speed - min(floor(speed), 7.0));
      if (dots > 0.5) { colour = vec4(base * (length(gl_PointCoord - 0.5) > 0.42 ? 0.8 : 1.0), 1.0); return; }
      colour = vec4(light(base, normalize(n), normalize(eye - place), sun), 1.0) * cover; }`],
  grains: [`in vec3 at, tone; in float radius; uniform mat4 view; uniform float size, cut; out vec3 middle, base; out float r;
    void main() { middle = at; base = tone; r = radius; gl_Position = at.y < cut || radius == 0.0 ? vec4(2.0, 2.0, 2.0, 1.0) : view * vec4(at, 1.0);
      gl_PointSize = 2.0 * radius * size / gl_Position.w; }`,
  `in vec3 middle, base; in float r; uniform mat4 view; uniform vec3 eye, sun, right, up, ahead; out vec4 colour;
    ${LIGHT}
    void main() {
      vec2 c = 2.0 * gl_PointCoord - 1.0;
      float deep = 1.0 - dot(c, c);
      if (deep < 0.0) discard;
      vec3 m = c.x * right - c.y * up - sqrt(deep) * ahead, place = middle + r * m;
      vec4 p = view * vec4(place, 1.0);
      gl_FragDepth = 0.5 + 0.5 * p.z / p.w;
      colour = vec4(light(base, m, normalize(eye - place), sun), 1.0); }`],
  plain: [`in vec3 at; uniform mat4 view; out vec3 place; void main() { place = at; gl_Position = view * vec4(at, 1.0); }`,
  `in vec3 place; uniform vec4 paint; uniform vec3 middle; uniform float tick, reach; out vec4 colour;
    float line(float x, float step, float strength) { float f = abs(fract(x / step - 0.5) - 0.5) * step / max(fwidth(x), 1e-9);
      return strength * (1.0 - min(f, 1.0)); }
    void main() { float a = paint.a;
      if (tick > 0.0) { vec2 p = place.xy;
        float lines = max(max(line(p.x, tick, 0.25), line(p.y, tick, 0.25)), max(line(p.x, 2.0 * tick, 0.5), line(p.y, 2.0 * tick, 0.5)));
        a = (0.10 + 0.5 * lines) * (1.0 - smoothstep(0.55 * reach, reach, distance(p, middle.xy))); }
      colour = vec4(paint.rgb * a, a); }`],
};
const TONE = [0.7, 0.695, 0.68]; // of concrete
const RAMP = [68, 1, 84, 71, 44, 122, 59, 81, 139, 44, 113, 142, 33, 144, 141, 39, 173, 129, 92, 200, 99, 170, 220, 50, 253, 231, 37];
const subtract = (a, b) => a.map((value, k) => value - b[k]), dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const crossed = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((value) => value / (Math.hypot(...a) || 1));

class Viewer {
  /* Draws on a canvas; throws where there is no WebGL 2. ``box``: low and high corner of what is to be seen; ``detail``:
     pixels that are drawn over those of the screen, along a side; ``smooth``: edges, which takes twice the time without a
     graphics card. */
  constructor(canvas, box, { smooth = true, ...given }) {
    this.canvas = canvas;
    this.detail = 1;
    this.fit(box, given);
    const gl = (this.gl = canvas.getContext("webgl2", { antialias: smooth, stencil: true, preserveDrawingBuffer: true, premultipliedAlpha: true }));
    if (!gl) throw new Error("no WebGL 2");
    this.programs = {};
    for (const [name, texts] of Object.entries(SHADERS)) {
      const program = gl.createProgram();
      texts.forEach((text, k) => {
        const shader = gl.createShader(k ? gl.FRAGMENT_SHADER : gl.VERTEX_SHADER);
        gl.shaderSource(shader, `#version 300 es\nprecision highp float;\n${text}`);
        gl.compileShader(shader);
        gl.attachShader(program, shader);
      });
      ["at", "normal", "shade", "tone", "radius"].forEach((each, k) => gl.bindAttribLocation(program, k, each));
      gl.linkProgram(program);
      if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
      const uniforms = {};
      for (let k = 0; k < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); k++) {
        const found = gl.getActiveUniform(program, k).name;
        uniforms[found.replace("[0]", "")] = gl.getUniformLocation(program, found);
      }
      this.programs[name] = { program, uniforms };
    }
  }

  /* Another box, seen from where a first one is seen. */
  fit(box, { floor, tick, flat }) {
    Object.assign(this, { box, floor, tick, flat, turn: flat ? 0 : 0.35, tilt: flat ? 0 : 0.27, zoom: 1 });
    this.middle = box[0].map((value, k) => 0.5 * (value + box[1][k]));
    this.reach = 1.6 * Math.hypot(box[1][0] - box[0][0], box[1][1] - box[0][1]);
  }

  /* A buffer of numbers, or of rows of triangles. */
  buffer(values, kind) {
    const gl = this.gl, found = gl.createBuffer();
    gl.bindBuffer(kind ?? gl.ARRAY_BUFFER, found);
    gl.bufferData(kind ?? gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
    return found;
  }

  /* The eye, its axes, and the matrix that takes a place to the picture. */
  look() {
    const ahead = [Math.sin(this.turn) * Math.cos(this.tilt), Math.cos(this.turn) * Math.cos(this.tilt), -Math.sin(this.tilt)];
    const right = unit([ahead[1], -ahead[0], 0]), up = crossed(right, ahead);
    const wide = Math.max(1, this.canvas.clientWidth) / Math.max(1, this.canvas.clientHeight), f = 1 / Math.tan(0.22), room = [0.94, 0.8];
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [0, 1, 2].map((a) => this.box[(k >> a) & 1][a]));
    let away = 0;
    for (const corner of corners) {
      const p = subtract(corner, this.middle), deep = dot(p, ahead);
      away = Math.max(away, (f * Math.abs(dot(p, right))) / wide / room[0] - deep, (f * Math.abs(dot(p, up))) / room[1] - deep);
    }
    away /= this.zoom;
    const eye = this.middle.map((value, k) => value - away * ahead[k]), near = 0.02 * away, far = 20 * away;
    const rows = [right.map((v) => (v * f) / wide), up.map((v) => v * f), ahead.map((v) => (v * (far + near)) / (far - near)), ahead];
    const shift = [0, 0, (-2 * far * near) / (far - near), 0];
    const view = new Float32Array(16);
    rows.forEach((row, r) => { row.forEach((v, c) => (view[4 * c + r] = v)); view[12 + r] = shift[r] - dot(row, eye); });
    Object.assign(this, { eye, view, right, up, ahead });
  }

  /* Where a place is in the picture, in pixels of the page. */
  project(p) {
    const [x, y, , w] = [0, 1, 2, 3].map((r) => this.view[r] * p[0] + this.view[4 + r] * p[1] + this.view[8 + r] * p[2] + this.view[12 + r]);
    return [0.5 * this.canvas.clientWidth * (1 + x / w), 0.5 * this.canvas.clientHeight * (1 - y / w)];
  }

  use(name, values) {
    const gl = this.gl, { program, uniforms } = this.programs[name];
    gl.useProgram(program);
    gl.uniformMatrix4fv(uniforms.view, false, this.view);
    for (const [key, value] of Object.entries(values)) {
      const place = uniforms[key];
      if (place === undefined) continue;
      if (typeof value === "number") gl.uniform1f(place, value);
      else if (value.length === 4) gl.uniform4fv(place, value);
      else gl.uniform3fv(place, value);
    }
  }

  /* Points (k, 3) as lines or triangles of one colour. */
  plain(points, kind, paint, more = {}) {
    const gl = this.gl;
    this.use("plain", { paint, tick: 0, reach: 1, middle: this.middle, ...more });
    const made = this.buffer(new Float32Array(points));
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    gl.drawArrays(kind, 0, points.length / 3);
    gl.deleteBuffer(made);
  }

  /* Grains as spheres. */
  spheres({ at, tone, radius, count }, values) {
    const gl = this.gl, { eye, right, up, ahead } = this;
    this.use("grains", { eye, right, up, ahead, ...values });
    [[0, at, 3], [3, tone, 3], [4, radius, 1]].forEach(([k, made, width]) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, made);
      gl.enableVertexAttribArray(k);
      gl.vertexAttribPointer(k, width, gl.FLOAT, false, 0, 0);
    });
    gl.drawArrays(gl.POINTS, 0, count);
    [3, 4].forEach((k) => gl.disableVertexAttribArray(k));
  }

  /* The face of a closed body where the plane y = ``cut`` opens it: seen through an odd number of its surfaces. */
  face(cut, body) {
    const gl = this.gl, [[left, , bottom], [right, , top]] = this.box, room = right - left + top - bottom;
    gl.enable(gl.STENCIL_TEST);
    gl.clear(gl.STENCIL_BUFFER_BIT);
    gl.stencilFunc(gl.ALWAYS, 0, 1);
    gl.stencilOp(gl.INVERT, gl.INVERT, gl.INVERT);
    gl.colorMask(false, false, false, false);
    gl.depthMask(false);
    body();
    gl.colorMask(true, true, true, true);
    gl.depthMask(true);
    gl.stencilFunc(gl.NOTEQUAL, 0, 1);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.KEEP);
    const corners = [[left - room, bottom - room], [right + room, bottom - room], [left - room, top + room], [right + room, top + room]];
    if (this.eye[1] < cut) this.plain(corners.flatMap(([x, z]) => [x, cut, z]), gl.TRIANGLE_STRIP, [...TONE.map((part) => 0.9 * part), 1]);
    gl.disable(gl.STENCIL_TEST);
  }

  /* A body as ``mesh`` prepared it, in a mode of colours, faces of glass, lines, and light or dark around; with ``grains``,
     buffers at, tone and radius of so many, seen through it, or beyond the plane y = ``cut`` at which it is cut open. */
  draw(mesh, { mode, panes, lines, dark, size, grains = null, cut = null }) {
    const gl = this.gl, canvas = this.canvas, ratio = this.detail * Math.min(2, window.devicePixelRatio || 1);
    [canvas.width, canvas.height] = [canvas.clientWidth, canvas.clientHeight].map((value) => Math.round(value * ratio));
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    this.look();
    const sun = unit([0, 1, 2].map((k) => -0.45 * this.right[k] + 0.6 * this.up[k] - 0.72 * this.ahead[k])), ink = dark ? [1, 1, 1] : [0.2, 0.25, 0.3];
    const level = this.floor, ground = level !== null && !this.flat;
    if (ground && this.tilt > 0) {
      const [x, y] = this.middle, r = this.reach;
      gl.depthMask(false);
      this.plain([x - r, y - r, level, x + r, y - r, level, x - r, y + r, level, x + r, y + r, level], gl.TRIANGLE_STRIP, [...ink, 0.5], { tick: this.tick, reach: r });
      gl.depthMask(true);
    }
    const many = { sun, eye: this.eye, mode, dots: mesh.corners ? 0 : 1, ramp: RAMP.map((v) => v / 255), tone: TONE, cut: cut ?? -1e9, cover: 1, size: (ratio * size * canvas.clientHeight) / 2 / Math.tan(0.22) };
    const body = (values) => {
      this.use("lit", { ...many, ...values });
      [[mesh.at, 3, gl.FLOAT, false], [mesh.normal, 3, gl.BYTE, true], [mesh.shade, 1, gl.UNSIGNED_BYTE, true]].forEach(([made, ...how], k) => {
        gl.bindBuffer(gl.ARRAY_BUFFER, made);
        gl.enableVertexAttribArray(k);
        gl.vertexAttribPointer(k, ...how, 0, 0);
      });
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, mesh.rows);
      if (mesh.corners) gl.drawElements(gl.TRIANGLES, mesh.count, gl.UNSIGNED_INT, 0);
      else gl.drawArrays(gl.POINTS, 0, mesh.count);
      [1, 2].forEach((k) => gl.disableVertexAttribArray(k));
    };
    if (ground && sun[2] > 0.2 && mesh.corners) { // its shadow, once a pixel
      gl.enable(gl.STENCIL_TEST);
      gl.stencilFunc(gl.EQUAL, 0, 255);
      gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
      gl.disable(gl.DEPTH_TEST);
      body({ flat_on: level, paint: [0, 0, 0, dark ? 0.4 : 0.16] });
      gl.enable(gl.DEPTH_TEST);
      gl.disable(gl.STENCIL_TEST);
    }
    const here = { flat_on: -1e9, paint: [0, 0, 0, 0] };
    if (grains) this.spheres(grains, { sun, cut: cut ?? -1e9, size: (ratio * canvas.clientHeight) / 2 / Math.tan(0.22) });
    if (cut !== null && mesh.corners) this.face(cut, () => body(here));
    if (grains && cut === null && mesh.corners) { // its nearest surface alone, over the grains
      gl.colorMask(false, false, false, false);
      body(here);
      gl.colorMask(true, true, true, true);
      gl.depthFunc(gl.LEQUAL);
      body({ ...here, cover: 0.5 });
      gl.depthFunc(gl.LESS);
    } else body(here);
    for (const { points, colour } of lines) this.plain(points, gl.LINES, colour);
    gl.depthMask(false);
    const pane = dark ? [0.55, 0.78, 0.9] : [0.38, 0.59, 0.69];
    for (const face of panes) this.plain(face.flat(), gl.TRIANGLE_FAN, [...pane, 0.13]);
    gl.depthMask(true);
    for (const face of panes) this.plain(face.flat(), gl.LINE_LOOP, [...pane, 0.9]);
  }
}

/* Turn by a mouse or a finger on a canvas. By its places: browsers leave out how far a finger has moved. */
function dragged(canvas, turn) {
  let at = null;
  canvas.onpointerdown = (down) => { canvas.setPointerCapture(down.pointerId); at = down; };
  canvas.onpointermove = (move) => {
    if (at?.pointerId !== move.pointerId) return;
    turn(0.008 * (move.clientX - at.clientX), 0.006 * (move.clientY - at.clientY));
    at = move;
  };
  canvas.onpointerup = canvas.onpointercancel = () => (at = null);
}

/* A measured length: an arrow, a level one below the body and joined with its ends. */
function dimension(viewer, { a, b, near, text, straight = false }) {
  const level = a[2] === b[2], round = level && !straight && a[0] === -b[0];
  if (round) { // a diameter: seen from everywhere
    const r = Math.hypot(...subtract(a, b)) / 2, [x, y] = viewer.right;
    [a, b] = [[-r * x, -r * y, a[2]], [r * x, r * y, a[2]]];
  }
  let [p, q] = [viewer.project(a), viewer.project(b)];
  const made = [];
  if (level) {
    const out = [0, 1].map((k) => -Math.abs(near) * Math.sign(viewer.ahead[k])), r = Math.abs(near); // of the body, towards the eye
    const before = round ? [[-r * viewer.ahead[0], -r * viewer.ahead[1], a[2]]] : [[a[0], out[1], a[2]], [b[0], out[1], a[2]]];
    const below = Math.min(viewer.canvas.clientHeight - 22, Math.max(p[1], q[1], ...before.map((place) => viewer.project(place)[1])) + 18);
    for (const [x, y] of [p, q]) made.push(svg("line", { x1: x, y1: y, x2: x, y2: below + 4, class: "thin" }));
    [p, q] = [[p[0], below], [q[0], below]];
  }
  made.push(svg("line", { x1: p[0], y1: p[1], x2: q[0], y2: q[1], "marker-start": "url(#head)", "marker-end": "url(#head)" }));
  const [x, y] = [0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1])], wide = 8 * text.length, end = Math.max(p[0], q[0]) + 7;
  const beside = wide > Math.abs(q[0] - p[0]) && end + wide < viewer.canvas.clientWidth; // of an arrow shorter than its text
  made.push(svg("text", !level ? { x: x + 7, y: y + 4 } : beside ? { x: end, y: y + 4 } : { x, y: y + 16, "text-anchor": "middle" }, text));
  const defs = svg("defs"), head = svg("marker", { id: "head", viewBox: "0 0 10 6", refX: 10, refY: 3, markerWidth: 10, markerHeight: 6, markerUnits: "userSpaceOnUse", orient: "auto-start-reverse" });
  head.append(svg("path", { d: "M0 0L10 3L0 6z" }));
  defs.append(head);
  return [defs, ...made];
}

// ---- packed numbers ----------------------------------------------------------------------------------------------
async function inflated(base64, Kind) {
  const packed = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
  const whole = new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate")));
  return new Kind(await whole.arrayBuffer());
}

/* Sums of differences, in place, of each of ``count`` rows of ``long`` numbers. */
function summed(values, long, count) {
  for (let row = 0; row < count; row++) for (let k = 1; k < long; k++) values[row * long + k] += values[row * long + k - 1];
  return values;
}
