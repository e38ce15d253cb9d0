// The page: shows the server's messages, and tells it what the user does.

import { drawCharts, legendItem, offerCharts, setChart } from "./charts.js";
import { connect, onSceneKey, send } from "./link.js";
import { enlarge, explainIou, setTiles } from "./tiles.js";
import { state } from "./time.js";
import { drawTimeline, setOverview } from "./timeline.js";

const by = (id) => document.getElementById(id);
let legends = {};
let isAllGood = false; // as far as is known: during tracking there is no verdict
const LEVELS = { good: "good", "usable with gaps": "usable", "not usable": "unusable" };

function notice(words) {
  by("notice").textContent = words;
  by("notice").hidden = !words;
}

function showTake(show) {
  document.title = `${show.take} · xormocap`;
  by("loading").hidden = true;
  notice(show.remark);
  showVerdict(show.verdict);
  by("energy").title = by("energy-words").textContent = show.words.energy;
  by("iou-words").textContent = show.words.iou;
  explainIou(show.words.iou);
  by("side").hidden = !show.has_tiles;
  by("frusta-label").hidden = !show.has_tiles;
  by("live-label").hidden = !show.is_live;
  enlarge(null);
  offer(by("content"), show.contents.map((name) => [name, name]), show.content);
  const windows = show.parts.filter(({ name }) => name !== "torso");
  offer(by("part"), [["", "whole pictures"], ...windows.map(({ name, words }) => [name, `${words}'s window`])], "");
  by("camera-list").replaceChildren(...show.cameras.map(cameraBox));
  by("legend").replaceChildren(...show.legend.map(colourMeaning));
  legends = show.legends;
  showLegend(show.content);
  by("frusta").checked = true;
  by("trails").checked = by("follow").checked = false;
  by("speed").value = "1";
  offerCharts(show.charts, show.chosen);
}

function showVerdict(verdict) {
  by("verdict").hidden = verdict === null;
  isAllGood = verdict === null || verdict.level === "good";
  if (verdict === null) return;
  by("verdict").className = LEVELS[verdict.level];
  by("headline").textContent = verdict.headline;
  by("doubts").textContent = verdict.doubts ? `Doubtful: ${verdict.doubts}.` : "";
  by("causes").replaceChildren(...verdict.causes.map((words) => {
    const item = document.createElement("li");
    item.textContent = words;
    return item;
  }));
  const [first = "", ...others] = verdict.causes;
  by("first-cause").textContent = others.length ? `${first} (and ${others.length} more: click)` : first;
}

function offer(select, options, chosen) {
  select.replaceChildren(...options.map(([value, words]) => new Option(words, value, false, value === chosen)));
}

function cameraBox(name, camera) {
  const label = document.createElement("label");
  const box = Object.assign(document.createElement("input"), { type: "checkbox", checked: true });
  box.dataset.camera = camera;
  box.onchange = sendTiles;
  label.append(box, ` ${name}`);
  return label;
}

/** What the tiles' colours mean. */
function showLegend(content) {
  const items = legends[content] ?? [];
  by("tiles-legend").replaceChildren(...items.map(colourMeaning));
  by("tiles-legend").hidden = items.length === 0;
}

function colourMeaning([rgb, words]) {
  return legendItem(`rgb(${rgb})`, words);
}

function showFrame(fields) {
  const isPlaying = fields.state === "playing";
  state.shown = fields.frame;
  notice("");
  by("words").textContent =
    `frame ${fields.frame}${fields.last === null ? "" : ` of ${fields.last}`}, ${fields.time_s.toFixed(2)} s, ${fields.state}`;
  by("frame-verdict").textContent = fields.verdict ?? "";
  const isDoubtful = fields.distrusted.some(Boolean);
  by("frame-verdict").classList.toggle("doubtful", isDoubtful);
  by("frame-verdict").classList.toggle("good", isAllGood && !isDoubtful);
  by("energy").textContent = fields.energy_px === null ? "" : `energy ${Math.round(fields.energy_px)} px`;
  by("numbers").textContent = numbers(fields).join(" · ");
  by("play").textContent = isPlaying ? "pause" : "play";
  by("live").checked = fields.state === "live";
  drawSoon();
}

let isDue = false;

/** Draw everything with a time axis once before the browser next paints. */
function drawSoon() {
  if (isDue) return;
  isDue = true;
  requestAnimationFrame(() => {
    isDue = false;
    drawTimeline();
    drawCharts();
  });
}

function numbers({ frames_per_s, behind_s }) {
  const found = [];
  if (frames_per_s !== null) found.push(`${frames_per_s.toFixed(1)} frames per second`);
  if (behind_s !== null) found.push(`page ${behind_s.toFixed(2)} s behind`);
  return found;
}

function sendTiles() {
  const chosen = [...by("camera-list").querySelectorAll("input:checked")];
  const cameras = chosen.map((box) => Number(box.dataset.camera));
  showLegend(by("content").value);
  send({ do: "show", content: by("content").value, part: by("part").value || null, cameras });
}

function sendRoom() {
  send({ do: "room", frusta: by("frusta").checked, trails: by("trails").checked, follow: by("follow").checked });
}

function fold() {
  const isFolded = by("side").toggleAttribute("hidden");
  by("unfold").hidden = !isFolded;
}

const actions = {
  back: () => send({ do: "step", frames: -1 }),
  on: () => send({ do: "step", frames: 1 }),
  play: () => send({ do: "play" }),
  "next-doubtful": (event) => send({ do: "doubtful", way: 1, by_stretch: event.shiftKey }),
  "previous-doubtful": (event) => send({ do: "doubtful", way: -1, by_stretch: event.shiftKey }),
  "frame-actor": () => send({ do: "frame", what: "actor" }),
  "frame-all": () => send({ do: "frame", what: "all" }),
  help: () => by("keys").showModal(),
  fold,
  unfold: fold,
};
const byKey = {
  " ": actions.play,
  ArrowLeft: (event) => send({ do: "step", frames: event.shiftKey ? -10 : -1 }),
  ArrowRight: (event) => send({ do: "step", frames: event.shiftKey ? 10 : 1 }),
  Home: () => send({ do: "seek", frame: state.first }),
  End: () => send({ do: "seek", frame: state.first + state.frames - 1 }),
  n: actions["next-doubtful"],
  p: actions["previous-doubtful"],
  f: actions["frame-actor"],
  a: actions["frame-all"],
  c: actions.fold,
  "?": actions.help,
  Escape: () => enlarge(null),
};

/** Do what a key of the page or of the 3D view stands for. */
function press(event) {
  const isTyping = ["SELECT", "INPUT", "TEXTAREA"].includes(event.target.tagName);
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if (isTyping || event.ctrlKey || event.metaKey || event.altKey || !byKey[key]) return;
  if (by("keys").open) return;
  event.preventDefault();
  event.stopPropagation(); // viser moves its camera by the arrow keys
  byKey[key](event);
}

for (const [id, act] of Object.entries(actions)) {
  by(id).onclick = (event) => {
    act(event);
    by(id).blur(); // so that space does not press it again
  };
}
for (const id of ["content", "part"]) by(id).onchange = () => { sendTiles(); by(id).blur(); };
for (const id of ["frusta", "trails", "follow"]) by(id).onchange = () => { sendRoom(); by(id).blur(); };
by("speed").onchange = () => { send({ do: "speed", factor: Number(by("speed").value) }); by("speed").blur(); };
by("live").onchange = () => { send({ do: "live", on: by("live").checked }); by("live").blur(); };
addEventListener("keydown", press);
onSceneKey(press);
addEventListener("resize", drawSoon);

connect({
  show: showTake,
  frame: showFrame,
  timeline: (fields, blobs) => { setOverview(fields, blobs); drawSoon(); },
  chart: (fields, blobs) => { setChart(fields, blobs); drawSoon(); },
  grid: setTiles,
  missing: ({ words }) => notice(words),
  notice: ({ words }) => { by("loading").hidden = true; notice(words); },
  closed: () => notice("The connection to the viewer is interrupted; the page goes on once it answers again."),
});
