// The time axis that timeline and curves share, and how a frame is picked on it.

import { send } from "./link.js";

export const GUTTER = 84;
const RIGHT = 10;
export const PARTS = ["torso", "head", "left arm", "right arm", "left leg", "right leg"];
export const state = { first: 0, frames: 1, shown: 0 };

/** Where a frame is on a canvas of this width, in CSS pixels: the middle of its column. */
export function xOf(frame, width) {
  return GUTTER + ((frame - state.first + 0.5) / state.frames) * (width - GUTTER - RIGHT);
}

/** The frame at a place. */
export function frameAt(x, width) {
  const at = Math.floor(((x - GUTTER) / (width - GUTTER - RIGHT)) * state.frames);
  return state.first + Math.min(Math.max(at, 0), state.frames - 1);
}

/** A canvas of the size that it has on the page, as sharp as the screen; its context in CSS pixels. */
export function cleared(canvas) {
  const { clientWidth: width, clientHeight: height } = canvas;
  const ratio = window.devicePixelRatio || 1;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

const patterns = new Map();

/** The hatching of doubtful frames. */
export function hatch(context, ground = "#f9d6d5") {
  if (patterns.has(ground)) return patterns.get(ground);
  const tile = document.createElement("canvas");
  tile.width = tile.height = 6;
  const pen = tile.getContext("2d");
  pen.fillStyle = ground;
  pen.fillRect(0, 0, 6, 6);
  pen.strokeStyle = "#c22f2f";
  pen.lineWidth = 2;
  for (const at of [-6, 0, 6]) {
    pen.beginPath();
    pen.moveTo(at - 1, 7);
    pen.lineTo(at + 7, -1);
    pen.stroke();
  }
  patterns.set(ground, context.createPattern(tile, "repeat"));
  return patterns.get(ground);
}

/** Stretches [begin, end) of indices whose flag is set. */
export function runs(flags) {
  const found = [];
  for (let i = 0; i < flags.length; i++) {
    if (flags[i] && (i === 0 || !flags[i - 1])) found.push([i, i + 1]);
    else if (flags[i]) found.at(-1)[1] = i + 1;
  }
  return found;
}

/** Draw the line at the shown frame. */
export function drawCursor(context, width, height) {
  const x = xOf(state.shown, width);
  context.fillStyle = "#102a43";
  context.fillRect(x - 1, 0, 2, height);
}

/** Show the frame that is clicked on a canvas, and those over which the pointer is dragged. */
export function makeClickable(canvas) {
  const seek = (event) => send({ do: "seek", frame: frameAt(event.offsetX, canvas.clientWidth) });
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    seek(event);
  });
  canvas.addEventListener("pointermove", (event) => event.buttons & 1 && seek(event));
}
