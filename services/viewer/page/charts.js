// The curves, on the timeline's axis; doubtful frames are shaded.

import { send } from "./link.js";
import { GUTTER, cleared, drawCursor, hatch, makeClickable, runs, state, xOf } from "./time.js";

const BOX = document.getElementById("charts");
const COLOURS = ["#486581", "#2f9e44", "#f35e00", "#1e96f0", "#9c36b5", "#a67c00"];
const BY_NAME = { left: "#f35e00", right: "#1e96f0" };
const TOP = 20;
let slots = [];

/** Offer charts by their titles; the chosen ones are shown. */
export function offerCharts(titles, chosen) {
  BOX.replaceChildren();
  slots = chosen.map((title) => makeSlot(titles, title));
}

function makeSlot(titles, title) {
  const box = document.createElement("div");
  box.className = "chart";
  const [canvas, select, legend] = ["canvas", "select", "div"].map((tag) => document.createElement(tag));
  select.ariaLabel = "curve";
  select.append(...titles.map((name) => new Option(name, name, false, name === title)));
  legend.className = "legend";
  box.append(canvas, select, legend);
  BOX.append(box);
  makeClickable(canvas);
  const slot = { canvas, select, legend, drawn: null };
  select.onchange = () => {
    slot.drawn = null;
    drawSlot(slot);
    send({ do: "charts", titles: slots.map((other) => other.select.value) });
    select.blur();
  };
  return slot;
}

/** A message with a chart's curves. */
export function setChart({ title, names, most }, [frames, doubtful, ...curves]) {
  const drawn = {
    names,
    most,
    frames: new Int32Array(frames),
    doubtful: new Uint8Array(doubtful),
    curves: curves.map((curve) => new Float32Array(curve)),
  };
  for (const slot of slots) if (slot.select.value === title) slot.drawn = drawn;
}

/** Draw all charts at the shown frame. */
export function drawCharts() {
  slots.filter(({ canvas }) => canvas.clientHeight).forEach(drawSlot);
}

function drawSlot(slot) {
  const { context, width, height } = cleared(slot.canvas);
  const { drawn } = slot;
  slot.canvas.dataset.points = drawn ? drawn.frames.length : 0;
  slot.canvas.dataset.shaded = drawn ? drawn.doubtful.reduce((sum, flag) => sum + flag, 0) : 0;
  slot.legend.replaceChildren();
  if (!drawn || !drawn.frames.length) return;
  shade(context, drawn, width, height);
  const [low, high] = limits(drawn);
  const y = (value) => TOP + (height - TOP - 5) * (1 - (value - low) / (high - low || 1));
  scale(context, low, high, y);
  drawn.curves.forEach((curve, k) => {
    context.strokeStyle = colour(drawn.names, k);
    context.lineWidth = 1.4;
    context.beginPath();
    let isDrawing = false;
    curve.forEach((value, i) => {
      if (Number.isFinite(value)) context[isDrawing ? "lineTo" : "moveTo"](xOf(drawn.frames[i], width), y(value));
      isDrawing = Number.isFinite(value);
    });
    context.stroke();
  });
  drawCursor(context, width, height);
  slot.legend.append(...drawn.names.map((name, k) => legendItem(colour(drawn.names, k), curveInWords(drawn, name, k))));
}

function shade(context, { frames, doubtful }, width, height) {
  context.fillStyle = hatch(context, "#fdeeee");
  context.globalAlpha = 0.35;
  for (const [begin, end] of runs(doubtful)) {
    const left = xOf(frames[begin] - 0.5, width);
    context.fillRect(left, 0, Math.max(xOf(frames[end - 1] + 0.5, width) - left, 2), height);
  }
  context.globalAlpha = 1;
}

function limits({ curves, most }) {
  if (most !== null) return [0, most];
  const known = curves.flatMap((curve) => [...curve].filter(Number.isFinite));
  if (!known.length) return [0, 1];
  return [known.reduce((a, b) => Math.min(a, b)), known.reduce((a, b) => Math.max(a, b))];
}

function scale(context, low, high, y) {
  context.font = "10px system-ui, sans-serif";
  context.fillStyle = "#627d98";
  context.textAlign = "right";
  context.textBaseline = "middle";
  const digits = high - low < 5 ? 2 : 0;
  for (const value of [low, high]) context.fillText(value.toFixed(digits), GUTTER - 6, y(value));
}

function colour(names, k) {
  return BY_NAME[names[k].split(" ")[0]] && names.length <= 2 ? BY_NAME[names[k]] : COLOURS[k % COLOURS.length];
}

/** A curve's name, and its value at the shown frame. */
function curveInWords(drawn, name, k) {
  const value = drawn.curves[k][drawn.frames.findLastIndex((frame) => frame <= state.shown)];
  return Number.isFinite(value) ? `${name} ${value.toFixed(Math.abs(value) < 5 ? 2 : 0)}` : name;
}

/** A dot of a colour, and what it stands for. */
export function legendItem(ink, words) {
  const item = document.createElement("span");
  const dot = document.createElement("i");
  dot.style.background = ink;
  item.append(dot, words);
  return item;
}
