// Recordings as they are in the page: deflated, in differences along time.
"use strict";

const find = (id) => document.getElementById(id);
const page = JSON.parse(find("data").textContent);
const clips = page.clips;

const loaded = new Map();

async function inflate(id) {
  const text = find(id).textContent.trim();
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).arrayBuffer();
}

/// The arrays of a clip, in the order in which they were written.
function load(number) {
  if (!loaded.has(number)) loaded.set(number, decode(number));
  return loaded.get(number);
}

async function decode(number) {
  const clip = clips[number];
  const {frames, nodes, grippers} = clip;
  const bytes = await inflate("clip-" + number);
  let at = 0;
  const take = (Type, count) => {
    const end = at + count * Type.BYTES_PER_ELEMENT;
    const array = new Type(bytes.slice(at, end));
    at = end;
    return array;
  };
  const times = take(Float32Array, frames);
  const poses = take(Float32Array, frames * grippers * 7);
  const ideal = clip.ideal ? take(Float32Array, nodes * 3) : null;
  const triangles = take(Uint32Array, clip.triangles * 3);
  const sides = take(Uint32Array, clip.sides * 2);
  const jaws = take(Uint8Array, frames * grippers);
  const grasped = take(Uint8Array, frames * nodes);
  const strains = sums(take(Uint8Array, frames * nodes), frames, nodes);
  const count = frames * nodes * 3;
  const planes = [0, 1, 2, 3].map(() => take(Uint8Array, count));
  const positions = new Float32Array(count);
  // Differences of differences along time, node by node and axis by axis, zigzag
  for (let axis = 0, k = 0; axis < 3; axis++) {
    for (let node = 0; node < nodes; node++) {
      let value = 0, step = 0;
      for (let frame = 0; frame < frames; frame++, k++) {
        const zigzag = planes[0][k] | planes[1][k] << 8 | planes[2][k] << 16 | planes[3][k] << 24;
        const change = (zigzag >>> 1) ^ -(zigzag & 1);
        if (frame === 0) value = change;
        else {
          step = step + change | 0;
          value = value + step | 0;
        }
        positions[(frame * nodes + node) * 3 + axis] = value * clip.unit;
      }
    }
  }
  return {clip, times, poses, ideal, triangles, sides, jaws, grasped, strains, positions};
}

/// Undoes differences modulo 256 along time, which are stored node by node.
function sums(bytes, frames, nodes) {
  const values = new Uint8Array(bytes.length);
  for (let node = 0, k = 0; node < nodes; node++) {
    let value = 0;
    for (let frame = 0; frame < frames; frame++, k++) {
      value = value + bytes[k] & 255;
      values[frame * nodes + node] = value;
    }
  }
  return values;
}

/// What is shown at a time: positions between two frames, the rest of the earlier one.
function moment(data, time) {
  const {times, positions, clip} = data;
  let low = 0, high = times.length - 1;
  while (high - low > 1) {
    const middle = low + high >> 1;
    if (times[middle] <= time) low = middle; else high = middle;
  }
  const span = times[high] - times[low];
  const share = span > 0 ? Math.min(Math.max((time - times[low]) / span, 0), 1) : 0;
  const frame = share === 1 ? high : low;
  const size = clip.nodes * 3;
  const shown = data.shown ??= new Float32Array(size);
  for (let k = 0; k < size; k++) {
    const from = positions[low * size + k];
    shown[k] = from + share * (positions[high * size + k] - from);
  }
  return {frame, low, high, share, positions: shown};
}

function pose(data, gripper, {low, high, share}) {
  const {poses, clip} = data;
  const from = (low * clip.grippers + gripper) * 7, to = (high * clip.grippers + gripper) * 7;
  let dot = 0;
  for (let k = 3; k < 7; k++) dot += poses[from + k] * poses[to + k];
  const mixed = Array.from({length: 7}, (_, k) => {
    const end = k < 3 || dot >= 0 ? poses[to + k] : -poses[to + k];
    return poses[from + k] + share * (end - poses[from + k]);
  });
  const length = Math.hypot(...mixed.slice(3));
  for (let k = 3; k < 7; k++) mixed[k] /= length;
  return mixed;
}

function transform([x, y, z, qx, qy, qz, qw], [a, b, c]) {
  // v + 2 w (q x v) + 2 q x (q x v)
  const u = [qy * c - qz * b, qz * a - qx * c, qx * b - qy * a];
  return [
    x + a + 2 * (qw * u[0] + qy * u[2] - qz * u[1]),
    y + b + 2 * (qw * u[1] + qz * u[0] - qx * u[2]),
    z + c + 2 * (qw * u[2] + qx * u[1] - qy * u[0]),
  ];
}
