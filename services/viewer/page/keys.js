// The keyboard.

import { onSceneKey, send } from "./link.js";
import { enlarge } from "./tiles.js";
import { state } from "./time.js";

/** Bind keys to the page and the 3D view; actions: what the buttons do, by their ids. */
export function bindKeys(actions) {
  const does = {
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
  const act = (event) => {
    const isTyping = ["SELECT", "INPUT", "TEXTAREA"].includes(event.target.tagName);
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (isTyping || event.ctrlKey || event.metaKey || event.altKey || !does[key]) return;
    if (document.getElementById("keys").open) return;
    event.preventDefault();
    event.stopPropagation(); // viser moves its camera by the arrow keys
    does[key](event);
  };
  addEventListener("keydown", act);
  onSceneKey(act);
}
