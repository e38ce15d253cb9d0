// The timeline of the whole take: its energy as a curve, and a row for each part, hatched where it is doubtful.

import { GUTTER, PARTS, cleared, drawCursor, hatch, makeClickable, runs, state, xOf } from "./time.js";

const CANVAS = document.getElementById("timeline");
const CURVE_HEIGHT = 34;
const ROW = 12;
let overview = null;

makeClickable(CANVAS);

/** A message with the whole take in bins. */
export function setOverview({ first, frames }, [known, distrusted, energy]) {
  state.first = first;
  state.frames = frames;
  overview = { known: new Uint8Array(known), distrusted: new Uint8Array(distrusted), energy: new Float32Array(energy) };
  const doubtful = PARTS.filter((_, part) => partFlags(part).some(Boolean));
  CANVAS.dataset.doubtful = doubtful.join(", ");
}

/** Draw all of it at the shown frame. */
export function drawTimeline() {
  CANVAS.ariaValueMin = state.first;
  CANVAS.ariaValueMax = state.first + state.frames - 1;
  CANVAS.ariaValueNow = state.shown;
  if (!overview) return;
  const { context, width, height } = cleared(CANVAS);
  const bins = overview.known.length;
  const left = (bin) => xOf(state.first - 0.5 + (bin * state.frames) / bins, width);
  drawEnergy(context, left);
  PARTS.forEach((name, part) => drawRow(context, left, name, part));
  drawCursor(context, width, height);
}

function partFlags(part) {
  return overview.known.map((_, bin) => overview.distrusted[bin * PARTS.length + part]);
}

function drawEnergy(context, left) {
  const top = Math.max(...overview.energy) || 1;
  label(context, "energy", CURVE_HEIGHT / 2);
  for (const [begin, end] of runs(overview.known)) {
    context.fillStyle = "#e6edf3";
    context.fillRect(left(begin), 0, left(end) - left(begin), CURVE_HEIGHT);
    context.strokeStyle = "#486581";
    context.lineWidth = 1.3;
    context.beginPath();
    for (let bin = begin; bin < end; bin++) {
      const x = (left(bin) + left(bin + 1)) / 2;
      context.lineTo(x, CURVE_HEIGHT - 2 - (CURVE_HEIGHT - 6) * (overview.energy[bin] / top));
    }
    context.stroke();
  }
}

function drawRow(context, left, name, part) {
  const y = CURVE_HEIGHT + part * ROW;
  const flags = partFlags(part);
  const isDoubtful = flags.some(Boolean);
  label(context, part === 0 ? "whole body" : name, y + ROW / 2, isDoubtful);
  for (const [begin, end] of runs(overview.known)) {
    context.fillStyle = "#d3ead8";
    context.fillRect(left(begin), y + 2, left(end) - left(begin), ROW - 3);
  }
  context.fillStyle = hatch(context);
  for (const [begin, end] of runs(flags)) {
    context.fillRect(left(begin), y + 1, Math.max(left(end) - left(begin), 2), ROW - 1);
  }
}

function label(context, words, y, isDoubtful = false) {
  context.font = `${isDoubtful ? "bold " : ""}11px system-ui, sans-serif`;
  context.fillStyle = isDoubtful ? "#c22f2f" : "#627d98";
  context.textAlign = "right";
  context.textBaseline = "middle";
  context.fillText(words, GUTTER - 6, y);
}
