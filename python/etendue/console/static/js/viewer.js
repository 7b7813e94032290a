// The page of `etendue view`: one scene, rendered by the server while the camera is moved here.

import { $, duration, h, settled, short, themeButton } from "./dom.js";
import { Orbit } from "./orbit.js";
import { decode, Picture } from "./picture.js";
import { OPERATOR_NAMES } from "./tone.js";

const stage = $("#stage");
const picture = new Picture(stage, { interactive: false, label: "The scene" });
let socket;
let about = null;
let orbit = null;
let own = null;
let pivot = null;
let layer = "rgb";
let isPaused = false;
let retry = 0;

const say = (order) => socket?.readyState === WebSocket.OPEN && socket.send(JSON.stringify(order));

// ---------------------------------------------------------------------------------------------------------------- controls

const select = (id, label, options, change) =>
  h("label", { class: "field" }, h("span", {}, label), h("select", { id, onchange: (e) => change(e.target.value) }, options.map((o) => h("option", { value: o }, o))));
const number = (id, label, attributes, change) =>
  h("label", { class: "field" }, h("span", {}, label), h("input", { id, type: "number", ...attributes, onchange: (e) => change(e.target.value === "" ? null : Number(e.target.value)) }));

const exposure = h("input", { id: "exposure", type: "range", min: "-8", max: "8", step: "0.1", value: "0", "aria-describedby": "exposure-value" });
const exposureValue = h("output", { id: "exposure-value", for: "exposure" }, "0 stops");
const setExposure = (v) => {
  const stops = Math.max(-8, Math.min(8, Math.round(v * 10) / 10));
  exposure.value = String(stops);
  exposureValue.textContent = `${stops > 0 ? "+" : ""}${stops} stops`;
  picture.set({ exposure: stops });
};
exposure.addEventListener("input", () => setExposure(Number(exposure.value)));

const setLayer = (name) => {
  layer = name;
  $("#layer").value = name;
  say({ type: "layer", layer: name });
};
const settings = (given) => say({ type: "settings", settings: given });
const save = (kind) => {
  const name = encodeURIComponent((about?.title ?? "picture").replace(/\.[^.]*$/, ""));
  const query = new URLSearchParams({ tonemap: picture.options.operator, exposure: String(picture.options.exposure) });
  const link = h("a", { href: `/save/${name}.${kind}?${query}`, download: "" });
  document.body.append(link);
  link.click();
  link.remove();
};
const pause = () => say({ type: "pause", paused: !isPaused });
const inspect = (on) => {
  picture.interactive = on;
  if (!on) picture.fit();
  stage.classList.toggle("inspecting", on);
  $("#inspect").setAttribute("aria-pressed", String(on));
};

$("#panel").append(
  h("section", {}, h("h2", {}, "Light"),
    select("integrator", "Integrator", [], (v) => settings({ integrator: v, max_depth: null })),
    number("max_depth", "Longest path", { min: "0", max: "10000", placeholder: "as the scene says" }, (v) => settings({ max_depth: v })),
    number("spp", "Samples per pixel", { min: "1", max: "1048576", placeholder: "antialiasing" }, (v) => settings({ spp: v }))),
  h("section", {}, h("h2", {}, "Picture"),
    select("layer", "Layer", ["rgb"], setLayer),
    h("label", { class: "field", for: "exposure" }, h("span", {}, "Exposure ", exposureValue), exposure),
    select("operator", "Tone mapping", OPERATOR_NAMES, (v) => picture.set({ operator: v })),
    number("width", "Width in pixels", { min: "16", max: "4096" }, (v) => v && settings({ width: v, height: null }))),
  h("section", {}, h("h2", {}, "Camera"),
    select("camera", "Camera", [], (v) => {
      settings({ camera: v });
      reset();
    }),
    h("div", { class: "row" },
      h("button", { type: "button", id: "reset", onclick: () => reset(), title: "Back to the file's camera (Home)" }, "Reset"),
      h("button", { type: "button", id: "inspect", "aria-pressed": "false", onclick: () => inspect(!picture.interactive), title: "Zoom into the picture's pixels (I)" }, "Inspect"),
      h("button", { type: "button", id: "copy", onclick: () => copyCamera(), title: "Copy the camera as a matrix for Scene.with_view" }, "Copy"))),
  h("section", {}, h("h2", {}, "Keep"),
    h("div", { class: "row" },
      h("button", { type: "button", id: "save-png", onclick: () => save("png") }, "PNG"),
      h("button", { type: "button", id: "save-exr", onclick: () => save("exr"), title: "All layers, unclipped" }, "EXR"),
      h("button", { type: "button", id: "pause", "aria-pressed": "false", onclick: pause, title: "Keep the picture as it is (Space)" }, "Pause"))),
  h("details", { id: "scene-details" }, h("summary", {}, "Scene"), h("dl", { id: "facts" }), h("div", { id: "losses" })),
  h("details", {}, h("summary", {}, "Keys"),
    h("dl", { class: "keys" }, ...[
      ["drag, arrows", "turn around the middle"],
      ["right drag, Shift + arrows", "move sideways"],
      ["wheel, + −", "nearer, farther"],
      ["Ctrl + wheel, [ ]", "longer, shorter lens"],
      ["Alt + drag", "look around"],
      ["double click", "turn around that point"],
      ["Home", "the file's camera"],
      ["E, Shift + E", "brighter, darker"],
      ["L, Shift + L", "next, previous layer"],
      ["T", "next tone mapping"],
      ["I", "inspect pixels"],
      ["Space", "pause"],
      ["S", "save as PNG"],
    ].flatMap(([k, what]) => [h("dt", {}, k), h("dd", {}, what)]))),
);
$("#theme-slot").append(themeButton());

async function copyCamera() {
  const m = orbit?.matrix ?? [];
  const rows = [0, 1, 2, 3].map((r) => `[${m.slice(4 * r, 4 * r + 4).map((v) => Number(v.toPrecision(9))).join(", ")}]`);
  const button = $("#copy");
  try {
    await navigator.clipboard.writeText(`scene.with_view([${rows.join(", ")}], ${Number(orbit.zoom.toPrecision(6))})`);
    button.textContent = "Copied";
  } catch {
    button.textContent = "Refused";
  }
  setTimeout(() => (button.textContent = "Copy"), 1500);
}

// ------------------------------------------------------------------------------------------------------------------- camera

const rest = settled(() => sendCamera(false), 180);
function sendCamera(moving) {
  if (!orbit) return;
  say({ type: "camera", matrix: orbit.matrix, zoom: orbit.zoom, moving });
}
let isQueued = false;
function moved() {
  // One order for each drawn frame is enough.
  if (!isQueued) {
    isQueued = true;
    requestAnimationFrame(() => {
      isQueued = false;
      sendCamera(true);
    });
  }
  rest();
}
function reset() {
  orbit = own ? new Orbit(own, pivot) : null;
  say({ type: "reset" });
}
function move(f) {
  if (!orbit) return;
  f(orbit);
  moved();
}

const drags = new Map();
stage.addEventListener("contextmenu", (e) => e.preventDefault());
stage.addEventListener("pointerdown", (e) => {
  if (picture.interactive) return;
  stage.focus({ preventScroll: true });
  stage.setPointerCapture(e.pointerId);
  drags.set(e.pointerId, [e.clientX, e.clientY]);
});
stage.addEventListener("pointermove", (e) => {
  const from = drags.get(e.pointerId);
  if (!from || picture.interactive) return;
  const size = Math.min(stage.clientWidth, stage.clientHeight) || 1;
  const [dx, dy] = [(e.clientX - from[0]) / size, (e.clientY - from[1]) / size];
  if (drags.size === 2) {
    // Two fingers: apart is nearer, together is farther, and both at once move.
    const [a, b] = [...drags.values()];
    const before = Math.hypot(a[0] - b[0], a[1] - b[1]);
    drags.set(e.pointerId, [e.clientX, e.clientY]);
    const [c, d] = [...drags.values()];
    const after = Math.hypot(c[0] - d[0], c[1] - d[1]);
    move((o) => {
      if (after > 0) o.dolly(before / after);
      o.pan(-dx / 2, dy / 2);
    });
    return;
  }
  drags.set(e.pointerId, [e.clientX, e.clientY]);
  const isPan = e.shiftKey || e.buttons & 6;
  move((o) => (isPan ? o.pan(-dx, dy) : e.altKey ? o.look(dx, -dy) : o.orbit(dx * Math.PI, dy * Math.PI)));
});
for (const type of ["pointerup", "pointercancel"]) stage.addEventListener(type, (e) => drags.delete(e.pointerId));
stage.addEventListener("wheel", (e) => {
  if (picture.interactive) return;
  e.preventDefault();
  move((o) => {
    if (e.ctrlKey || about?.projection === "orthographic") o.zoom = Math.max(1e-3, Math.min(1e3, o.zoom * 2 ** (-e.deltaY / 400)));
    else o.dolly(2 ** (e.deltaY / 400));
  });
}, { passive: false });
stage.addEventListener("dblclick", (e) => {
  const at = picture.pixelAt(e);
  if (picture.interactive || !orbit || !at) return;
  say({ type: "point", u: (at.x + 0.5) / picture.frame.width, v: (at.y + 0.5) / picture.frame.height });
});

const next = (list, now, step) => list[(list.indexOf(now) + step + list.length) % list.length];
document.addEventListener("keydown", (e) => {
  if (e.target.closest("input, select, textarea, button, summary") || e.ctrlKey || e.metaKey) return;
  const step = 0.08;
  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  const key = e.key.length === 1 ? e.key.toLowerCase() : e.key;
  if (picture.interactive && (arrows[key] || "+-=01".includes(key))) return;
  if (arrows[key]) {
    const [x, y] = arrows[key];
    move((o) => (e.shiftKey ? o.pan(x * step, y * step) : o.orbit(-x * step * 2, y * step * 2)));
  } else if (key === "+" || key === "=" || key === "PageUp") move((o) => o.dolly(1 / 1.15));
  else if (key === "-" || key === "PageDown") move((o) => o.dolly(1.15));
  else if (key === "[") move((o) => (o.zoom /= 1.15));
  else if (key === "]") move((o) => (o.zoom *= 1.15));
  else if (key === "Home") reset();
  else if (key === "e") setExposure(picture.options.exposure + (e.shiftKey ? -0.5 : 0.5));
  else if (key === "l") setLayer(next([...$("#layer").options].map((o) => o.value), layer, e.shiftKey ? -1 : 1));
  else if (key === "t") {
    $("#operator").value = next(OPERATOR_NAMES, picture.options.operator, 1);
    picture.set({ operator: $("#operator").value });
  } else if (key === "i") inspect(!picture.interactive);
  else if (key === " ") pause();
  else if (key === "s") save("png");
  else return;
  e.preventDefault();
});

// --------------------------------------------------------------------------------------------------------------- the server

function fill(element, names, chosen) {
  element.replaceChildren(...names.map((n) => h("option", { value: n }, n)));
  element.value = chosen;
}

function meet(message) {
  about = message;
  document.title = `${message.title} – Etendue`;
  $("#title").textContent = message.title;
  const { info } = message;
  fill($("#integrator"), message.integrators, message.settings.integrator ?? info.integrator ?? message.integrators[0]);
  const cameras = info.cameras.length ? info.cameras.map(([name], i) => name || String(i)) : ["the scene's"];
  fill($("#camera"), cameras, message.settings.camera ?? cameras[0]);
  $("#camera").closest("label").hidden = cameras.length < 2;
  about.projection = info.cameras[0]?.[1];
  $("#width").value = message.width;
  $("#spp").value = message.settings.spp ?? "";
  own = message.matrix;
  const facts = [
    ["Format", info.format],
    ["File size in pixels", info.width ? `${info.width} × ${info.height}` : "not said"],
    ["Shapes", info.shapes],
    ["Triangles", info.triangles.toLocaleString("en")],
    ["Instances", info.instances],
    ["Lights", info.lights.length + info.emissive_shapes],
    ["Materials", info.bsdfs],
    ["Textures", info.textures],
    ["Files", info.files.join(", ")],
  ];
  $("#facts").replaceChildren(...facts.flatMap(([k, v]) => [h("dt", {}, k), h("dd", {}, String(v))]));
  const said = [
    ...message.warnings.map(([file, line, text]) => h("li", {}, `${file}${line ? `:${line}` : ""}: ${text}`)),
    ...message.losses.map(([file, line, what, effect]) => h("li", {}, `${file}${line ? `:${line}` : ""}: ${what}: ${effect}`)),
  ];
  $("#losses").replaceChildren(...(said.length ? [h("h3", {}, `Warnings and losses (${said.length})`), h("ul", {}, said)] : []));
}

function state(message) {
  isPaused = message.paused;
  $("#pause").setAttribute("aria-pressed", String(isPaused));
  $("#error").hidden = !message.error;
  $("#error").textContent = message.error ?? "";
  if (message.error && !picture.frame) $("#status").textContent = "";
}

function show(buffer) {
  const frame = decode(buffer);
  const names = [...$("#layer").options].map((o) => o.value);
  if (names.join() !== frame.layers.join()) fill($("#layer"), frame.layers, layer);
  if (frame.pivot) pivot = frame.pivot;
  if (!orbit && own) orbit = new Orbit(own, pivot);
  picture.show(frame);
  const target = frame.target ? ` of ${frame.target}` : "";
  const noise = frame.error === null ? "" : `, error ${(100 * frame.error).toFixed(frame.error < 0.01 ? 2 : 1)} %`;
  const size = frame.scale > 1 ? `coarse 1:${frame.scale}` : `${frame.spp}${target} spp`;
  $("#status").textContent = `${frame.width} × ${frame.height}, ${size}${noise}, ${duration(frame.seconds)}${frame.done ? ", done" : ""}`;
  document.body.dataset.spp = String(frame.scale > 1 ? 0 : frame.spp);
  document.body.dataset.done = String(frame.done);
  document.body.dataset.generation = String(frame.generation);
  say({ type: "ready" });
}

function connect() {
  socket = new WebSocket(`ws://${location.host}/live`);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => {
    retry = 0;
    $("#status").textContent = "Rendering …";
    if (layer !== "rgb") say({ type: "layer", layer });
  };
  socket.onmessage = ({ data }) => {
    if (data instanceof ArrayBuffer) {
      show(data);
      return;
    }
    const message = JSON.parse(data);
    if (message.type === "scene") meet(message);
    else if (message.type === "state") state(message);
    else if (message.type === "point") {
      if (message.point && orbit) orbit.pivot = message.point;
    } else if (message.type === "refused") state({ error: message.message, paused: isPaused });
  };
  socket.onclose = () => {
    $("#status").textContent = "The renderer has ended. Start `etendue view` again.";
    retry = Math.min(10, retry + 1);
    setTimeout(connect, 500 * retry);
  };
}

picture.addEventListener("pixel", ({ detail }) => {
  $("#pixel").textContent = detail ? `${detail.x}, ${detail.y}: ${detail.values.map((v) => short(v)).join("  ")}` : "";
});
$("#layer").value = layer;
connect();
