// The timeline of the whole take: its energy as a curve, and a row for each part: hatched where it is doubtful,
// grey where it was not judged.

import { GUTTER, PARTS, cleared, drawCursor, hatch, makeClickable, runs, state, xOf } from "./time.js";

const CANVAS = document.getElementById("timeline");
const CURVE_HEIGHT = 34;
const ROW = 12;
const GOOD = "#d3ead8";
const UNJUDGED = "#c3cad2";
let overview = null;

makeClickable(CANVAS);

/** A message with the whole take in bins. */
export function setOverview({ first, frames }, [known, doubtful, unjudged, energy]) {
  state.first = first;
  state.frames = frames;
  const [isKnown, isDoubtful, isUnjudged] = [known, doubtful, unjudged].map((flags) => new Uint8Array(flags));
  overview = { known: isKnown, doubtful: isDoubtful, unjudged: isUnjudged, energy: new Float32Array(energy) };
  for (const kind of ["doubtful", "unjudged"]) {
    CANVAS.dataset[kind] = PARTS.filter((_, part) => partFlags(kind, part).some(Boolean)).join(", ");
  }
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

/** Of each bin, whether a part is doubtful or unjudged there. */
function partFlags(kind, part) {
  return overview.known.map((_, bin) => overview[kind][bin * PARTS.length + part]);
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
  const flags = partFlags("doubtful", part);
  label(context, part === 0 ? "whole body" : name, y + ROW / 2, flags.some(Boolean));
  for (const [ink, known] of [[GOOD, overview.known], [UNJUDGED, partFlags("unjudged", part)]]) {
    context.fillStyle = ink;
    for (const [begin, end] of runs(known)) context.fillRect(left(begin), y + 2, left(end) - left(begin), ROW - 3);
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
