// One moment of a recording, by WebGL 2.
"use strict";

// ---- Vectors and the camera

const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const add = (a, b, share = 1) => [a[0] + share * b[0], a[1] + share * b[1], a[2] + share * b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0],
];
const unit = (a) => {
  const length = Math.hypot(...a) || 1;
  return [a[0] / length, a[1] / length, a[2] / length];
};

const HALF_ANGLE = 0.22;
const camera = {target: [0, 0, 0], azimuth: 0, elevation: 0, distance: 1};

function axes() {
  const run = Math.cos(camera.elevation), rise = Math.sin(camera.elevation);
  const back = [Math.cos(camera.azimuth) * run, Math.sin(camera.azimuth) * run, rise];
  const right = [-Math.sin(camera.azimuth), Math.cos(camera.azimuth), 0];
  return {back, right, up: cross(back, right), eye: add(camera.target, back, camera.distance)};
}

/// Column by column, for a view of some width and height.
function projection(width, height) {
  const {back, right, up, eye} = axes();
  const focus = 1 / Math.tan(HALF_ANGLE);
  const fx = focus * Math.min(1, height / width), fy = focus * Math.min(1, width / height);
  const near = 0.02 * camera.distance, far = 20 * camera.distance;
  const a = -(far + near) / (far - near), b = -2 * far * near / (far - near);
  const matrix = [];
  for (let k = 0; k < 3; k++) matrix.push(fx * right[k], fy * up[k], a * back[k], -back[k]);
  const [x, y, z] = [right, up, back].map((axis) => -dot(axis, eye));
  matrix.push(fx * x, fy * y, a * z + b, -z);
  return new Float32Array(matrix);
}

// ---- The one shader

const canvas = find("view");
const gl = canvas.getContext("webgl2", {antialias: true, stencil: true, alpha: false});
if (!gl) {
  find("no-webgl").hidden = false;
  throw new Error("no WebGL 2");
}
const VERTEX = `#version 300 es
in vec3 position, normal; in vec4 colour;
uniform mat4 camera; uniform vec4 flatten;
out vec3 n; out vec4 c;
void main() {
  // Shadows: along the light down to the table
  vec3 p = mix(position, vec3(position.xy - flatten.xy * position.z, 0.0), flatten.w);
  gl_Position = camera * vec4(p, 1.0);
  n = normal; c = colour;
}`;
const FRAGMENT = `#version 300 es
precision highp float;
in vec3 n; in vec4 c;
uniform vec4 front, back; uniform float lit, own; uniform vec3 light;
out vec4 pixel;
void main() {
  vec4 base = mix(gl_FrontFacing ? front : back, c, own);
  float s = (gl_FrontFacing ? 1.0 : -1.0) * dot(normalize(n), light);
  float bright = mix(1.0, 0.72 + 0.34 * max(s, 0.0) - 0.22 * max(-s, 0.0), lit);
  pixel = vec4(base.rgb * bright, base.a);
}`;
const program = gl.createProgram();
for (const [type, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
  const shader = gl.createShader(type);
  gl.shaderSource(shader, source);
  gl.compileShader(shader);
  if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) console.error(gl.getShaderInfoLog(shader));
  gl.attachShader(program, shader);
}
["position", "normal", "colour"].forEach((name, k) => gl.bindAttribLocation(program, k, name));
gl.linkProgram(program);
gl.useProgram(program);
const uniform = (name) => gl.getUniformLocation(program, name);
const U = Object.fromEntries(
  ["camera", "flatten", "front", "back", "lit", "own", "light"].map((name) => [name, uniform(name)]));
const buffers = [3, 3, 4].map((size, k) => {
  const buffer = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  gl.enableVertexAttribArray(k);
  gl.vertexAttribPointer(k, size, gl.FLOAT, false, 0, 0);
  return buffer;
});
const indexBuffer = gl.createBuffer();
gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, indexBuffer);
const LIGHT = unit([0.35, -0.25, 0.9]);

function upload(...arrays) {
  arrays.forEach((array, k) => {
    gl.bindBuffer(gl.ARRAY_BUFFER, buffers[k]);
    gl.bufferData(gl.ARRAY_BUFFER, array, gl.DYNAMIC_DRAW);
  });
}

function draw(mode, indices, {front, back = front, lit = 0, own = 0, flatten = [0, 0, 0, 0]}) {
  gl.uniform4fv(U.front, front);
  gl.uniform4fv(U.back, back);
  gl.uniform1f(U.lit, lit);
  gl.uniform1f(U.own, own);
  gl.uniform4fv(U.flatten, flatten);
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.DYNAMIC_DRAW);
  gl.drawElements(mode, indices.length, gl.UNSIGNED_INT, 0);
}

/// Flat triangles and lines that are made anew in every picture.
function drawPoints(mode, points, colour) {
  if (!points.length) return;
  const positions = new Float32Array(points.flat());
  upload(positions, positions, new Float32Array(points.length * 4));
  draw(mode, Uint32Array.from(points.keys()), {front: colour});
}

// ---- What is drawn

let colours = {};
function readColours() {
  const style = getComputedStyle(document.documentElement);
  const read = (name) => {
    const hex = style.getPropertyValue("--" + name).trim().slice(1);
    return [0, 2, 4].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255);
  };
  colours = Object.fromEntries(["stage", "lines", "front", "back", "thread", "grasped", "gripper",
    "path", "ideal"].map((name) => [name, read(name)]));
}
const tint = (name, opacity = 1) => [...colours[name], opacity];

/// From dark to light, for eyes of any kind (after viridis by van der Walt and Smith).
const SCALE = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
function scaled(share) {
  const at = Math.min(Math.max(share, 0), 1) * (SCALE.length - 1);
  const k = Math.min(Math.floor(at), SCALE.length - 2);
  return SCALE[k].map((value, j) => (value + (at - k) * (SCALE[k + 1][j] - value)) / 255);
}

function normals(positions, triangles) {
  const sums = new Float32Array(positions.length);
  for (let k = 0; k < triangles.length; k += 3) {
    const [a, b, c] = [0, 1, 2].map((j) => triangles[k + j] * 3);
    const [p, q] = [b, c].map((j) =>
      [positions[j] - positions[a], positions[j + 1] - positions[a + 1], positions[j + 2] - positions[a + 2]]);
    const n = cross(p, q);
    for (const j of [a, b, c]) for (let i = 0; i < 3; i++) sums[j + i] += n[i];
  }
  return sums;
}

/// How many layers lie below each node: triangles that it is above and no corner of.
function layers(positions, triangles) {
  const count = positions.length / 3, below = new Uint8Array(count);
  let low = [Infinity, Infinity], high = [-Infinity, -Infinity];
  for (let k = 0; k < positions.length; k += 3) {
    for (const j of [0, 1]) {
      low[j] = Math.min(low[j], positions[k + j]);
      high[j] = Math.max(high[j], positions[k + j]);
    }
  }
  const cell = Math.max(high[0] - low[0], high[1] - low[1], 1e-6) / 64;
  const cellAt = (value, j) => Math.floor((value - low[j]) / cell);
  const cells = new Map();
  for (let t = 0; t < triangles.length; t += 3) {
    const corners = [0, 1, 2].map((j) => triangles[t + j] * 3);
    const range = [0, 1].map((j) => {
      const values = corners.map((k) => positions[k + j]);
      return [cellAt(Math.min(...values), j), cellAt(Math.max(...values), j)];
    });
    for (let x = range[0][0]; x <= range[0][1]; x++) {
      for (let y = range[1][0]; y <= range[1][1]; y++) {
        const key = x * 65536 + y;
        if (!cells.has(key)) cells.set(key, []);
        cells.get(key).push(t);
      }
    }
  }
  for (let node = 0; node < count; node++) {
    const [x, y, z] = positions.subarray(node * 3, node * 3 + 3);
    for (const t of cells.get(cellAt(x, 0) * 65536 + cellAt(y, 1)) ?? []) {
      const [a, b, c] = [0, 1, 2].map((j) => triangles[t + j]);
      if (a === node || b === node || c === node) continue;
      const [p, q, r] = [a, b, c].map((k) => positions.subarray(k * 3, k * 3 + 3));
      const area = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
      if (Math.abs(area) < 1e-12) continue;
      const ofB = ((x - p[0]) * (r[1] - p[1]) - (y - p[1]) * (r[0] - p[0])) / area;
      const ofC = ((q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0])) / area;
      if (ofB < 0 || ofC < 0 || ofB + ofC >= 1) continue;
      if (z > p[2] + ofB * (q[2] - p[2]) + ofC * (r[2] - p[2])) below[node]++;
    }
  }
  return below;
}

/// Colours of the nodes, or none for the two sides of the cloth.
function nodeColours(kind, data, now) {
  const {clip} = data, count = clip.nodes;
  let share;
  if (kind === "strain") share = (node) => data.strains[now.frame * count + node] / 255;
  if (kind === "height") {
    const top = Math.max(clip.high[2], 1e-6);
    share = (node) => now.positions[node * 3 + 2] / top;
  }
  if (kind === "layer") {
    const below = layers(now.positions, data.triangles);
    share = (node) => below[node] / 4;
  }
  if (!share) return null;
  const values = new Float32Array(count * 4);
  for (let node = 0; node < count; node++) values.set([...scaled(share(node)), 1], node * 4);
  return values;
}

/// A line as two triangles that face the camera, so that it can be wider than a pixel.
function ribbon(into, a, b, width, eye) {
  const away = unit(cross(sub(b, a), sub(eye, a)));
  const at = (p, sign) => {
    const size = width * Math.hypot(...sub(p, eye));
    return add(add(p, away, sign * size), unit(sub(eye, p)), 2 * size);
  };
  const [p, q, r, s] = [at(a, -1), at(b, -1), at(b, 1), at(a, 1)];
  into.push(p, q, r, p, r, s);
}

function drawTable(clip) {
  const margin = 0.12;
  let cell = 0.1;
  while (Math.max(clip.high[0] - clip.low[0], clip.high[1] - clip.low[1]) / cell > 200) cell *= 10;
  const low = [0, 1].map((k) => Math.floor((clip.low[k] - margin) / cell));
  const high = [0, 1].map((k) => Math.ceil((clip.high[k] + margin) / cell));
  const points = [];
  for (let x = low[0]; x <= high[0]; x++) points.push([x * cell, low[1] * cell, 0], [x * cell, high[1] * cell, 0]);
  for (let y = low[1]; y <= high[1]; y++) points.push([low[0] * cell, y * cell, 0], [high[0] * cell, y * cell, 0]);
  drawPoints(gl.LINES, points, tint("lines"));
}

function drawScene(data, time, options, width, height) {
  const {clip, triangles, sides} = data;
  const now = moment(data, time);
  const {eye, right, up} = axes();
  const pixel = 2 * Math.tan(HALF_ANGLE) / Math.min(width, height) * (window.devicePixelRatio || 1);
  gl.uniformMatrix4fv(U.camera, false, projection(width, height));
  gl.uniform3fv(U.light, LIGHT);
  gl.disable(gl.DEPTH_TEST);
  drawTable(clip);

  // Cloth: its shadow, its faces, its threads
  const own = nodeColours(options.colour, data, now);
  upload(now.positions, normals(now.positions, triangles), own ?? new Float32Array(clip.nodes * 4));
  gl.enable(gl.STENCIL_TEST);
  gl.stencilFunc(gl.EQUAL, 0, 255);
  gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
  draw(gl.TRIANGLES, triangles,
    {front: [0.06, 0.08, 0.14, 0.22], flatten: [LIGHT[0] / LIGHT[2], LIGHT[1] / LIGHT[2], 0, 1]});
  gl.disable(gl.STENCIL_TEST);
  gl.enable(gl.DEPTH_TEST);
  gl.enable(gl.POLYGON_OFFSET_FILL);
  gl.polygonOffset(1, 1);
  draw(gl.TRIANGLES, triangles,
    {front: tint("front"), back: tint("back"), lit: own ? 0.6 : 1, own: own ? 1 : 0});
  gl.disable(gl.POLYGON_OFFSET_FILL);
  if (options.threads) draw(gl.LINES, sides, {front: tint("thread", 0.28)});

  // Grippers: way, volume, held nodes
  gl.depthMask(false);
  for (let gripper = 0; gripper < clip.grippers; gripper++) {
    const state = pose(data, gripper, now);
    if (options.path) {
      const way = [];
      for (let k = 1; k <= now.low; k++) {
        const [a, b] = [k - 1, k].map((f) => f * clip.grippers + gripper);
        if (data.jaws[a] && data.jaws[b]) {
          ribbon(way, [...data.poses.subarray(a * 7, a * 7 + 3)], [...data.poses.subarray(b * 7, b * 7 + 3)],
            0.8 * pixel, eye);
        }
      }
      drawPoints(gl.TRIANGLES, way, tint("path", 0.85));
    }
    if (options.gripper && clip.volumes[gripper]) {
      const {corners, edges} = clip.volumes[gripper];
      const closed = data.jaws[now.frame * clip.grippers + gripper];
      const lines = [];
      for (const [a, b] of edges) {
        ribbon(lines, transform(state, corners[a]), transform(state, corners[b]), (closed ? 1.5 : 0.7) * pixel, eye);
      }
      drawPoints(gl.TRIANGLES, lines, tint("gripper", closed ? 1 : 0.75));
    }
  }
  const discs = [];
  for (let node = 0; node < clip.nodes; node++) {
    if (!data.grasped[now.frame * clip.nodes + node]) continue;
    const centre = [...now.positions.subarray(node * 3, node * 3 + 3)];
    const radius = 4 * pixel * Math.hypot(...sub(centre, eye));
    const lifted = add(centre, unit(sub(eye, centre)), 2 * radius);
    const rim = (k) => {
      const angle = k * Math.PI / 6;
      return add(add(lifted, right, radius * Math.cos(angle)), up, radius * Math.sin(angle));
    };
    for (let k = 0; k < 12; k++) discs.push(lifted, rim(k), rim(k + 1));
  }
  drawPoints(gl.TRIANGLES, discs, tint("grasped"));

  if (options.ideal && data.ideal) {
    upload(data.ideal, normals(data.ideal, triangles), new Float32Array(clip.nodes * 4));
    draw(gl.TRIANGLES, triangles, {front: tint("ideal", 0.18)});
    draw(gl.LINES, sides, {front: tint("ideal", 0.35)});
  }
  gl.depthMask(true);
  return now;
}
