"use strict";
/* The film of a body: its pictures from packed numbers, what stands around it, and its pace; with viewer.js. */

/* Points, normals, shades and rows of triangles of each picture; a section is turned about the axis. */
async function decoded(film) {
  const [positions, normals, colours, rows] = await Promise.all([
    inflated(film.positions, Int16Array), inflated(film.normals, Int8Array), inflated(film.colours, Uint8Array), inflated(film.rows, Int32Array)]);
  let first = 0, row = 0;
  return film.counts.map((count, picture) => {
    const links = film.links[picture], c = film.corners[picture], codes = summed(positions.slice(3 * first, 3 * (first + count)), count, 3);
    const at = new Float32Array(3 * count), normal = new Int8Array(3 * count), shade = colours.slice(first, first + count);
    for (let i = 0; i < count; i++) for (let k = 0; k < 3; k++) {
      at[3 * i + k] = film.low[k] + film.step[k] * codes[k * count + i];
      normal[3 * i + k] = normals[3 * first + k * count + i];
    }
    const part = rows.slice(row, row + c * links), triangles = new Uint32Array(c * links);
    for (let i = 0, begin = 0; i < links; i++) {
      begin += part[i];
      for (let k = 0; k < c; k++) triangles[c * i + k] = begin + (k ? part[k * links + i] : 0);
    }
    first += count;
    row += c * links;
    const made = { at, normal, shade, triangles };
    return { ...(c === 2 ? revolved(made, film.sectors) : made), corners: c };
  });
}

/* A section turned about the axis in n sectors. */
function revolved({ at, normal, shade, triangles }, n) {
  const count = shade.length, links = triangles.length / 2;
  const made = { at: new Float32Array(3 * n * count), normal: new Int8Array(3 * n * count), shade: new Uint8Array(n * count), triangles: new Uint32Array(6 * n * links) };
  for (let i = 0; i < count; i++) for (let s = 0; s < n; s++) {
    const angle = (2 * Math.PI * s) / n, put = 3 * (i * n + s);
    for (const key of ["at", "normal"]) {
      const [r, , z] = { at, normal }[key].subarray(3 * i, 3 * i + 3);
      made[key].set([r * Math.cos(angle), r * Math.sin(angle), z], put);
    }
    made.shade[i * n + s] = shade[i];
  }
  for (let i = 0; i < links; i++) for (let s = 0; s < n; s++) {
    const next = (s + 1) % n, a = triangles[2 * i] * n, b = triangles[2 * i + 1] * n;
    made.triangles.set([a + s, b + s, a + next, b + s, b + next, a + next], 6 * (i * n + s));
  }
  return made;
}

/* A picture on the graphics card, once. */
function onCard(viewer, made) {
  const { at, normal, shade, triangles, corners } = made;
  made.card ??= { at: viewer.buffer(at), normal: viewer.buffer(normal), shade: viewer.buffer(shade), rows: viewer.buffer(triangles, viewer.gl.ELEMENT_ARRAY_BUFFER), corners, count: corners ? triangles.length : shade.length };
  return made.card;
}

/* Centres of the grains in each picture, and how far each has come; none where there are none. */
async function decodedGrains({ grains, times, low, step }) {
  if (!grains) return [];
  const { centres, radii, free } = grains, codes = await inflated(centres, Int16Array), long = 3 * radii.length;
  for (let k = long; k < codes.length; k++) codes[k] += codes[k - long];
  const places = times.map((_, k) => Float32Array.from(codes.subarray(k * long, (k + 1) * long), (code, i) => low[i % 3] + step[i % 3] * code));
  const there = (at, g) => at[3 * g] > low[0] - 1e4 * step[0]; // else it has not entered yet
  const first = radii.map((_, g) => places.find((at) => there(at, g)));
  const way = (at) => radii.map((_, g) => (there(at, g) ? Math.hypot(...free.map((on, k) => on * (at[3 * g + k] - first[g][3 * g + k]))) : 0));
  return places.map((at) => ({ at, way: way(at), radius: radii.map((r, g) => (there(at, g) ? r : 0)) }));
}

/* Grains of a picture on the graphics card, once, coloured by size unless ``tone`` says otherwise. */
function grainsOnCard(viewer, made, { kinds, colours }, tone = kinds.map((kind) => colours[kind % colours.length])) {
  made.card ??= { at: viewer.buffer(made.at), tone: viewer.buffer(new Float32Array(tone.flat())), radius: viewer.buffer(new Float32Array(made.radius)), count: made.radius.length };
  return made.card;
}

/* Pairs of places of polylines x, y, z with null between; dashed by leaving out every third part. */
function segments([x, y, z], size, dashed) {
  const found = [], step = 0.012 * size;
  for (let k = 1; k < x.length; k++) {
    if (x[k] === null || x[k - 1] === null) continue;
    const a = [x[k - 1], y[k - 1], z[k - 1]], b = [x[k], y[k], z[k]], parts = dashed ? Math.max(1, 2 * Math.floor(Math.hypot(...subtract(b, a)) / step / 2)) : 1;
    const at = (fraction) => a.map((value, i) => value + fraction * (b[i] - value));
    if (dashed && parts === 1 && k % 3 === 0) continue;
    for (let part = 0; part < parts; part += 2) found.push(...at(part / parts), ...at(Math.min(1, (part + 1) / parts)));
  }
  return found;
}

/* What a viewer draws around a body: glass, and lines of the mould and of walls; and the size of a particle. */
function around({ low, high, outline, walls, vessel, size }, dark) {
  const long = Math.max(...subtract(high, low));
  const lines = [{ points: segments(outline, long, true), colour: dark ? [1, 0.5, 0.4, 1] : [0.77, 0.24, 0.15, 1] }, { points: segments(walls, long), colour: [0.5, 0.53, 0.57, 1] }];
  return { panes: vessel, lines: lines.filter((line) => line.points.length), dark, size: 1.24 * size };
}

/* Box and options of the viewer of a body. */
function fitting({ low, high, floor, dimension }) {
  const size = Math.max(...subtract(high, low)), tick = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1].find((value) => value >= size / 14) ?? 2;
  return [[low, high], { floor, tick, flat: dimension === 2 }];
}

/* Flow time over time of a film, such that it lasts some seconds, and its words. */
function pace({ times }) {
  const long = times.at(-1) - times[0];
  const speed = long < 1.2 ? [0.5, 0.25, 0.1, 0.05, 0.02, 0.01].find((value) => long / value >= 1.2) ?? 0.01 : [1, 2, 5, 10, 20, 50, 100, 200, 500].find((value) => long / value <= 12) ?? 1000;
  const words = { 1: "real time", 0.5: "half speed", 0.25: "quarter speed", 2: "double speed" };
  return [speed, words[speed] ?? `${speed}x speed`];
}
