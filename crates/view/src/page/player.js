// What is shown when, and the controls.
"use strict";

// ---- State and controls

const state = {time: 0, playing: false, speed: 1, shown: [0, null]};
let dirty = true, ready = [];
const end = () => Math.max(...shownClips().map((number) => clips[number].end));
const start = () => Math.min(...shownClips().map((number) => clips[number].start));
const shownClips = () => state.shown.filter((number) => number !== null);
const cases = [...new Set(clips.map((clip) => clip.case))];
const solvers = [...new Set(clips.map((clip) => clip.solver))];
const numberOf = (name, solver) =>
  clips.findIndex((clip) => clip.case === name && clip.solver === solver);

function fill(select, names) {
  select.replaceChildren(...names.map((name) => new Option(name, name)));
}
for (const side of ["left", "right"]) {
  fill(find(side + "-case"), cases);
  fill(find(side + "-solver"), solvers);
  for (const what of ["case", "solver"]) find(side + "-" + what).addEventListener("change", choose);
}
find("compare").addEventListener("change", choose);

async function choose() {
  const chosen = (side) => {
    const number = numberOf(find(side + "-case").value, find(side + "-solver").value);
    return number < 0 ? null : number;
  };
  const compare = find("compare").checked;
  find("right").hidden = !compare;
  state.shown = [chosen("left"), compare ? chosen("right") : null];
  const wanted = state.shown;
  const missing = (number, side) => number === null && (side === 0 || compare);
  find("missing").hidden = !wanted.some(missing);
  const data = await Promise.all(shownClips().map(load));
  if (wanted !== state.shown) return;
  ready = data;
  const range = find("time");
  if (data.length) {
    range.min = start();
    range.max = end();
    setTime(Math.min(state.time, end()));
  }
  labels();
  dirty = true;
}

function labels() {
  const names = ready.map(({clip}) => [clip.case, clip.solver].filter(Boolean).join(" · "));
  ["left-label", "right-label"].forEach((id, k) => {
    find(id).textContent = names[k] ?? "";
    find(id).hidden = !names[k];
  });
  find("stage").classList.toggle("two", ready.length > 1);
  canvas.setAttribute("aria-label", "Cloth and gripper: " + names.join(" beside "));
  for (const row of document.querySelectorAll("tr[data-case]")) {
    const shown = ready.some(({clip}) => clip.case === row.dataset.case);
    row.classList.toggle("shown", shown);
  }
}

/// Shows a case: with both solvers beside each other if it has two.
function show(name) {
  const found = solvers.filter((solver) => numberOf(name, solver) >= 0);
  for (const [side, solver] of [["left", found[0]], ["right", found[1] ?? found[0]]]) {
    find(side + "-case").value = name;
    find(side + "-solver").value = solver;
  }
  find("compare").checked = found.length > 1;
  return choose();
}

function setTime(time) {
  state.time = Math.min(Math.max(time, start()), end());
  const range = find("time");
  range.value = state.time;
  range.setAttribute("aria-valuetext", state.time.toFixed(2) + " seconds");
  dirty = true;
}

function play(on) {
  if (on && state.time >= end() - 1e-6) setTime(start());
  state.playing = on;
  find("play").textContent = on ? "Pause" : "Play";
  find("play").setAttribute("aria-pressed", String(on));
  last = null;
  dirty = true;
}

find("play").addEventListener("click", () => play(!state.playing));
find("time").addEventListener("input", (event) => {
  play(false);
  setTime(Number(event.target.value));
});
find("speed").addEventListener("change", (event) => { state.speed = Number(event.target.value); });
find("colour").addEventListener("change", () => { legend(); dirty = true; });
for (const id of ["threads", "path", "gripper", "ideal"]) {
  find(id).addEventListener("change", () => { dirty = true; });
}
find("ideal").disabled = !clips.some((clip) => clip.ideal);

const LEGENDS = {
  strain: ["up to 0.01 %", "0.1 %", "1 %", "10 % edge strain"],
  layer: ["on the table", "on 1 layer", "2", "3", "4 or more"],
};
function legend() {
  const kind = find("colour").value;
  const height = Math.max(...shownClips().map((number) => clips[number].high[2]));
  const words = kind === "height" ? ["0 m", height.toFixed(2) + " m high"] : LEGENDS[kind];
  find("legend").hidden = !words;
  find("legend-words").replaceChildren(...(words ?? []).map((word) => {
    const item = document.createElement("span");
    item.textContent = word;
    return item;
  }));
}
find("legend-bar").style.background =
  "linear-gradient(90deg," + SCALE.map((colour) => "rgb(" + colour + ")") + ")";

// ---- Where it is seen from

const VIEWS = {corner: [-1.05, 0.62], top: [-Math.PI / 2, 1.57], side: [-Math.PI / 2, 0.08]};

/// Width and height of a recording's part of the view.
function viewSize() {
  const [width, height] = [canvas.clientWidth || 1, canvas.clientHeight || 1];
  const share = 1 / Math.max(shownClips().length, 1);
  return width >= height ? [width * share, height] : [width, height * share];
}

function look(name) {
  let low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (const number of shownClips()) {
    low = low.map((value, k) => Math.min(value, clips[number].low[k]));
    high = high.map((value, k) => Math.max(value, clips[number].high[k]));
  }
  [camera.azimuth, camera.elevation] = VIEWS[name];
  camera.target = add(low, sub(high, low), 0.5);
  // As near as all corners of the box around the cloth are seen
  const [x, y] = viewSize();
  const {back, right, up} = axes();
  camera.distance = 0.01;
  for (let k = 0; k < 8; k++) {
    const corner = [0, 1, 2].map((j) => (k >> j & 1 ? high : low)[j] - camera.target[j]);
    for (const [axis, share] of [[right, Math.min(x, y) / x], [up, Math.min(x, y) / y]]) {
      const wanted = Math.abs(dot(corner, axis)) * share / Math.tan(HALF_ANGLE) / 0.92;
      camera.distance = Math.max(camera.distance, dot(corner, back) + wanted);
    }
  }
  dirty = true;
}
for (const name of Object.keys(VIEWS)) find("look-" + name).addEventListener("click", () => look(name));


function orbit(dx, dy) {
  camera.azimuth -= dx;
  camera.elevation = Math.min(Math.max(camera.elevation + dy, -1.57), 1.57);
  dirty = true;
}
function pan(dx, dy) {
  const {right, up} = axes();
  camera.target = add(add(camera.target, right, -dx * camera.distance), up, dy * camera.distance);
  dirty = true;
}
function zoom(factor) {
  camera.distance = Math.min(Math.max(camera.distance * factor, 0.01), 1000);
  dirty = true;
}

const fingers = new Map();
canvas.addEventListener("pointerdown", (event) => {
  canvas.setPointerCapture(event.pointerId);
  fingers.set(event.pointerId, [event.clientX, event.clientY]);
});
for (const name of ["pointerup", "pointercancel"]) {
  canvas.addEventListener(name, (event) => fingers.delete(event.pointerId));
}
canvas.addEventListener("pointermove", (event) => {
  const before = fingers.get(event.pointerId);
  if (!before) return;
  const now = [event.clientX, event.clientY];
  const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
  if (fingers.size === 2) {
    const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
    const apart = (finger) => Math.hypot(finger[0] - other[0], finger[1] - other[1]) || 1;
    zoom(apart(before) / apart(now));
    pan(dx / 2000, dy / 2000);
  } else if (event.shiftKey || event.buttons & 6) pan(dx / 1000, dy / 1000);
  else orbit(dx / 150, dy / 150);
  fingers.set(event.pointerId, now);
});
canvas.addEventListener("contextmenu", (event) => event.preventDefault());
canvas.addEventListener("wheel", (event) => {
  // The page scrolls on until the view has been clicked.
  if (document.activeElement !== canvas) return;
  event.preventDefault();
  zoom(Math.exp(event.deltaY / 600));
}, {passive: false});
canvas.addEventListener("keydown", (event) => {
  const move = event.shiftKey ? (x, y) => pan(x / 40, y / 40) : (x, y) => orbit(x / 10, y / 10);
  const keys = {
    ArrowLeft: () => move(-1, 0), ArrowRight: () => move(1, 0),
    ArrowUp: () => move(0, -1), ArrowDown: () => move(0, 1),
    "+": () => zoom(0.9), "=": () => zoom(0.9), "-": () => zoom(1.1),
    " ": () => play(!state.playing), Home: () => look("corner"),
    ",": () => setTime(state.time - 0.05), ".": () => setTime(state.time + 0.05),
  };
  if (keys[event.key] && !event.ctrlKey && !event.metaKey) {
    event.preventDefault();
    keys[event.key]();
  }
});

// ---- Pictures

let last = null;
function tick(now) {
  if (state.playing && ready.length) {
    if (last !== null) setTime(state.time + state.speed * (now - last) / 1000);
    last = now;
    if (state.time >= end()) play(false);
  }
  if (dirty && ready.length) {
    dirty = false;
    paint();
  }
  requestAnimationFrame(tick);
}

function paint() {
  const scale = window.devicePixelRatio || 1;
  const width = Math.max(1, Math.round(canvas.clientWidth * scale));
  const height = Math.max(1, Math.round(canvas.clientHeight * scale));
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, {width, height});
  gl.enable(gl.BLEND);
  gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  gl.clearColor(...colours.stage, 1);
  gl.disable(gl.SCISSOR_TEST);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
  gl.enable(gl.SCISSOR_TEST);
  // Beside each other, or below on a narrow screen
  const wide = width >= height, share = 1 / ready.length;
  const options = {colour: find("colour").value};
  for (const id of ["threads", "path", "gripper", "ideal"]) options[id] = find(id).checked;
  const words = ready.map((data, k) => {
    const box = wide
      ? [Math.round(k * share * width), 0, Math.round(share * width), height]
      : [0, Math.round((1 - (k + 1) * share) * height), width, Math.round(share * height)];
    gl.viewport(...box);
    gl.scissor(...box);
    const now = drawScene(data, state.time, options, box[2], box[3]);
    const held = data.grasped.subarray(now.frame * data.clip.nodes, (now.frame + 1) * data.clip.nodes)
      .reduce((sum, holder) => sum + (holder > 0), 0);
    const {curve} = data.clip;
    const value = curve.length
      ? ", " + page.curve_name + " = " + at(curve, state.time).toPrecision(3) : "";
    const name = [data.clip.case, data.clip.solver].filter(Boolean).join(" ");
    return name + ": " + (held ? held + (held > 1 ? " nodes" : " node") + " held" : "nothing held") + value;
  });
  find("clock").textContent = state.time.toFixed(2) + " s";
  find("state").textContent = words.join(" — ");
  document.dispatchEvent(new CustomEvent("moment", {detail: {time: state.time, shown: shownClips()}}));
  document.documentElement.dataset.painted = state.time.toFixed(2);
}

/// The value of a curve at a time.
function at(curve, time) {
  let k = curve.findIndex((point) => point[0] > time + 1e-9);
  if (k < 0) k = curve.length;
  return curve[Math.max(k - 1, 0)][1];
}

// ---- Start

readColours();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  readColours();
  dirty = true;
});
new ResizeObserver(() => { dirty = true; }).observe(canvas);
for (const row of document.querySelectorAll("tr[data-case]")) {
  const button = row.querySelector("button");
  button?.addEventListener("click", async () => {
    await show(row.dataset.case);
    setTime(start());
    play(true);
    find("stage").scrollIntoView({block: "nearest"});
  });
}
document.addEventListener("seek", (event) => { play(false); setTime(event.detail); });
canvas.addEventListener("webglcontextlost", () => { find("no-webgl").hidden = false; });
show(cases[0]).then(() => {
  look("corner");
  legend();
  requestAnimationFrame(tick);
}, (error) => {
  find("broken").hidden = false;
  console.error(error);
});
