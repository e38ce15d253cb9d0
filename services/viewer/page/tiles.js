// The cameras' tiles, as large as they fit, with the IoU of each and the worst one marked.

import { send } from "./link.js";

const SIDE = document.getElementById("side");
const GRID = document.getElementById("cameras");
const GAP = 3;
const BAD_IOU = 0.82; // usual even in wide clothes
let shape = 0.75;
let iouInWords = "";

/** What the IoU is, as shown where the pointer rests on one. */
export function explainIou(words) {
  iouInWords = words;
}

/** A message with the pictures of a frame. */
export function setTiles({ frame, tiles }, blobs) {
  const ious = tiles.map((tile) => tile.iou ?? 2);
  const worst = tiles.length > 1 && Math.min(...ious) < 2 ? ious.indexOf(Math.min(...ious)) : -1;
  GRID.classList.add("told"); // an empty grid is now the user's choice
  const before = GRID.children.length;
  while (GRID.children.length > tiles.length) GRID.lastChild.remove();
  while (GRID.children.length < tiles.length) GRID.append(makeTile());
  if (before !== tiles.length) layOut();
  tiles.forEach((tile, n) => fill(GRID.children[n], tile, frame, blobs[n], n === worst));
}

function makeTile() {
  const box = document.createElement("div");
  const image = new Image();
  const [name, iou, none] = ["name", "iou", "none"].map((kind) => {
    return Object.assign(document.createElement("span"), { className: kind });
  });
  image.onload = () => {
    URL.revokeObjectURL(image.src);
    const found = image.naturalHeight / image.naturalWidth;
    if (GRID.firstChild === box && Math.abs(found - shape) > 0.01) {
      shape = found;
      layOut();
    }
  };
  box.append(image, name, iou, none);
  box.ondblclick = () => enlarge(SIDE.classList.contains("large") ? null : Number(box.dataset.camera));
  return box;
}

function fill(box, tile, frame, jpeg, isWorst) {
  const [image, name, iou, none] = box.children;
  image.src = URL.createObjectURL(new Blob([jpeg], { type: "image/jpeg" }));
  image.alt = tile.name;
  image.dataset.frame = frame;
  box.dataset.camera = tile.camera;
  box.className = `tile${isWorst ? " worst" : ""}${tile.iou !== null && tile.iou < BAD_IOU ? " bad" : ""}`;
  name.replaceChildren(tile.name, extra(tile.differing_px === null ? "" : ` · ${tile.differing_px} px`));
  none.textContent = tile.missing;
  iou.title = iouInWords;
  iou.replaceChildren(extra(isWorst ? "worst " : ""), tile.iou === null ? "" : `IoU ${tile.iou.toFixed(2)}`);
}

/** Words that a narrow tile leaves out. */
function extra(words) {
  return Object.assign(document.createElement("small"), { textContent: words });
}

/** Show one camera alone, or again all (null). */
export function enlarge(camera) {
  SIDE.classList.toggle("large", camera !== null);
  send({ do: "enlarge", camera });
}

/** Choose the number of columns with which the tiles are largest. */
export function layOut() {
  const { clientWidth, clientHeight } = GRID;
  const count = Math.max(GRID.children.length, 1);
  let best = { width: 0, columns: 1 };
  for (let columns = 1; columns <= count; columns++) {
    const rows = Math.ceil(count / columns);
    const across = (clientWidth - GAP * (columns + 1)) / columns;
    const down = (clientHeight - GAP * (rows + 1)) / rows / shape;
    if (Math.min(across, down) > best.width) best = { width: Math.min(across, down), columns };
  }
  const [width, height] = [Math.floor(best.width), Math.floor(best.width * shape)];
  GRID.style.gridTemplateColumns = `repeat(${best.columns}, ${width}px)`;
  GRID.style.gridAutoRows = `${height}px`;
}

new ResizeObserver(layOut).observe(GRID);
