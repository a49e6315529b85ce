// The curves: a logarithmic axis, values where the pointer is, a line at the player's time.
"use strict";
(() => {
const holder = document.getElementById("chart");
const {clips, curve_name: yName} = JSON.parse(document.getElementById("data").textContent);
const curves = clips.map((clip, number) => ({...clip, number})).filter((clip) => clip.curve.length);
if (!holder || !curves.length) return;

const SVG = "http://www.w3.org/2000/svg";
const cases = [...new Set(curves.map((curve) => curve.case))];
const solvers = [...new Set(curves.map((curve) => curve.solver))];
const margin = {left: 54, right: 14, top: 22, bottom: 40};
const values = curves.flatMap((curve) => curve.curve.map((point) => point[1])).filter((y) => y > 0);
const most = Math.max(...values);
const top = Math.ceil(Math.log10(most)), bottom = Math.max(Math.floor(Math.log10(Math.min(...values))), top - 4);
const first = Math.min(...curves.map((curve) => curve.curve[0][0]));
const last = Math.max(...curves.map((curve) => curve.curve.at(-1)[0]));
let width = 0, shown = [], now = null;
const height = 340;
const x = (t) => margin.left + (t - first) / (last - first || 1) * (width - margin.left - margin.right);
const y = (value) => {
  const share = (top - Math.log10(value)) / (top - bottom);
  return margin.top + share * (height - margin.top - margin.bottom);
};

function make(name, attributes, parent, text) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== undefined) element.textContent = text;
  parent?.append(element);
  return element;
}

/// A step that leaves about so many marks.
function round(span, count) {
  const rough = span / count, size = 10 ** Math.floor(Math.log10(rough));
  return size * [1, 2, 5, 10].find((factor) => factor * size >= rough);
}

const svg = make("svg", {role: "img", "aria-label": yName + " over time; the table has the last values"});
const readout = document.createElement("ul");
readout.className = "readout";
holder.append(svg, readout);

function draw() {
  width = Math.max(holder.clientWidth, 200);
  svg.replaceChildren();
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  svg.setAttribute("width", width);
  svg.setAttribute("height", height);
  const grid = make("g", {class: "grid"}, svg);
  for (let power = bottom; power <= top; power++) {
    const at = y(10 ** power);
    make("line", {x1: margin.left, x2: width - margin.right, y1: at, y2: at}, grid);
    make("text", {x: margin.left - 8, y: at + 4, "text-anchor": "end"}, grid, Number((10 ** power).toPrecision(1)));
  }
  const step = round(last - first || 1, width / 90);
  for (let t = Math.ceil(first / step) * step; t <= last + 1e-9; t += step) {
    make("line", {x1: x(t), x2: x(t), y1: margin.top, y2: height - margin.bottom}, grid);
    make("text", {x: x(t), y: height - margin.bottom + 18, "text-anchor": "middle"}, grid, Number(t.toFixed(6)));
  }
  make("text", {x: (margin.left + width) / 2, y: height - 4, "text-anchor": "middle"}, grid, "t [s]");
  make("text", {x: margin.left, y: 12}, grid, yName);
  for (const curve of curves) {
    const points = curve.curve.filter((point) => point[1] >= 10 ** bottom);
    const path = points.map(([t, value], k) => (k ? "L" : "M") + x(t).toFixed(1) + " " + y(value).toFixed(1));
    curve.path = make("path", {d: path.join(""), class: "curve"}, svg);
    curve.path.style.stroke = `var(--line-${cases.indexOf(curve.case) % 8})`;
    if (solvers.indexOf(curve.solver) > 0) curve.path.setAttribute("stroke-dasharray", "5 3");
  }
  svg.cursor = make("line", {class: "cursor", y1: margin.top, y2: height - margin.bottom}, svg);
  mark();
}

function mark() {
  for (const curve of curves) {
    const main = !shown.length || shown.includes(curve.number);
    curve.path.classList.toggle("faint", !main);
  }
  if (now === null) return;
  const at = Math.min(Math.max(now, first), last);
  svg.cursor.setAttribute("x1", x(at));
  svg.cursor.setAttribute("x2", x(at));
  const rows = curves.map((curve) => {
    const later = curve.curve.findIndex((point) => point[0] > at + 1e-9);
    const point = curve.curve[Math.max((later < 0 ? curve.curve.length : later) - 1, 0)];
    return {curve, value: point[1]};
  });
  readout.replaceChildren(...rows.map(({curve, value}) => {
    const item = document.createElement("li");
    item.classList.toggle("faint", shown.length > 0 && !shown.includes(curve.number));
    const key = document.createElement("span");
    key.className = solvers.indexOf(curve.solver) > 0 ? "key dashed" : "key";
    key.style.borderColor = curve.path.style.stroke;
    const number = document.createElement("b");
    number.textContent = value.toPrecision(3);
    item.append(key, [curve.case, curve.solver].filter(Boolean).join(" ") + " ", number);
    return item;
  }));
}

const timeAt = (event) => {
  const box = svg.getBoundingClientRect();
  const share = (event.clientX - box.left - margin.left) / (box.width - margin.left - margin.right);
  return first + Math.min(Math.max(share, 0), 1) * (last - first);
};
svg.addEventListener("pointermove", (event) => { now = timeAt(event); mark(); });
svg.addEventListener("click", (event) => {
  document.dispatchEvent(new CustomEvent("seek", {detail: timeAt(event)}));
});
document.addEventListener("moment", (event) => {
  ({time: now, shown} = event.detail);
  mark();
});
now = last;
new ResizeObserver(draw).observe(holder);
})();
