// The connection to the page's server: messages in, the user's actions out.

const SCENE = document.getElementById("scene");
const AGAIN_MS = 250;
const LOOK_MS = 1000;

let socket = null;
let key = "";

/** Begin: open the 3D scene, find the key in it, connect, and begin again when the server comes back.
 *  handlers: a function (fields, blobs) for each kind of message, and `closed`. */
export function connect(handlers) {
  const scheme = location.protocol === "https:" ? "wss:" : "ws:";
  SCENE.src = `index.html?websocket=${scheme}//${location.host}/scene`;
  setInterval(() => {
    const found = SCENE.contentDocument?.querySelector("#xormocap-key")?.dataset.key;
    if (found && found !== key) {
      key = found; // tried once only: browsers delay all connections to a server that refuses many
      open(`${scheme}//${location.host}/channel?key=${key}`, handlers);
    }
    tidyScene();
  }, AGAIN_MS);
  setInterval(async () => {
    if (socket?.readyState !== WebSocket.CLOSED) return;
    const answer = await fetch("page.html", { cache: "no-store" }).catch(() => null);
    if (answer?.ok && socket?.readyState === WebSocket.CLOSED) {
      socket = null;
      SCENE.contentWindow.location.reload(); // which gets a new key
    }
  }, LOOK_MS);
}

/** Send what the user did. */
export function send(action) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(action));
}

function open(url, handlers) {
  socket?.close();
  const mine = (socket = new WebSocket(url));
  mine.binaryType = "arraybuffer";
  mine.onmessage = ({ data }) => {
    const length = new DataView(data).getUint32(0, true);
    const fields = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
    let at = 4 + length;
    const blobs = fields.blobs.map((size) => data.slice(at, (at += size)));
    try {
      handlers[fields.kind]?.(fields, blobs);
    } finally {
      mine.send(JSON.stringify({ do: "seen", number: fields.number }));
    }
  };
  mine.onclose = () => mine === socket && handlers.closed();
}

/** Hide what viser shows beside the scene: its panel, which only holds the key, and its notices. */
function tidyScene() {
  const scene = SCENE.contentDocument;
  const canvas = scene?.querySelector("canvas");
  let panel = scene?.querySelector("#xormocap-key");
  if (!canvas || !panel) return;
  while (panel.parentElement && !panel.parentElement.contains(canvas)) panel = panel.parentElement;
  panel.style.display = "none";
  if (scene.getElementById("xormocap-style")) return;
  const style = Object.assign(scene.createElement("style"), { id: "xormocap-style" });
  style.textContent = '[class*="mantine-Notification"] { display: none !important; }';
  scene.head.append(style);
}

/** Call a function with every key that is pressed while the 3D scene has the focus. */
export function onSceneKey(act) {
  SCENE.addEventListener("load", () => SCENE.contentWindow.addEventListener("keydown", act, true));
}
