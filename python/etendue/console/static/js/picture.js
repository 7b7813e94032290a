// The picture on the page: exposure, tone mapping, layers, zoom, values of pixels, comparison. Used by the viewer and by the console.

import { develop, developDifference, fromHalves } from "./tone.js";

/** Reads a layer as etendue/console/wire.py writes it. */
export function decode(buffer) {
  const view = new DataView(buffer);
  const length = view.getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const at = 4 + length;
  const size = header.width * header.height * header.channels;
  const data = header.dtype === "f4" ? new Float32Array(buffer, at, size) : fromHalves(new Uint16Array(buffer, at, size));
  return { ...header, data };
}

const MOST_ZOOM = 64;

/** Shows frames in an element. Events: `pixel` (detail: {x, y, values, other} or null), `zoom`. */
export class Picture extends EventTarget {
  #frame = null;
  #other = null;
  #options = { exposure: 0, operator: "standard" };
  #mode = "single";
  #wipe = 0.5;
  #zoom = 1;
  #pan = [0, 0];
  #fits = true;
  #scheduled = false;

  /** @param host an element; it is filled with a canvas. */
  constructor(host, { interactive = true, label = "Picture" } = {}) {
    super();
    this.host = host;
    host.classList.add("picture");
    this.canvas = document.createElement("canvas");
    this.canvas.width = this.canvas.height = 1;
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", label);
    host.append(this.canvas);
    this.handle = document.createElement("input");
    Object.assign(this.handle, { type: "range", min: "0", max: "1", step: "0.001", value: "0.5", hidden: true, className: "wipe" });
    this.handle.setAttribute("aria-label", "Where the two pictures meet");
    this.handle.addEventListener("input", () => {
      this.#wipe = Number(this.handle.value);
      this.redraw();
    });
    host.append(this.handle);
    this.interactive = interactive;
    new ResizeObserver(() => this.#place()).observe(host);
    host.addEventListener("pointermove", (e) => this.#point(e));
    host.addEventListener("pointerleave", () => this.dispatchEvent(new CustomEvent("pixel", { detail: null })));
    this.#listen();
  }

  get frame() {
    return this.#frame;
  }

  get options() {
    return this.#options;
  }

  get zoom() {
    return this.#zoom;
  }

  set label(text) {
    this.canvas.setAttribute("aria-label", text);
  }

  /** Shows a frame; `base` is the size that it stands for where it is coarser. */
  show(frame) {
    const old = this.#frame;
    this.#frame = frame;
    if (!old || old.width !== frame.width || old.height !== frame.height) this.#place();
    this.redraw();
  }

  /** A second frame to compare with, and how: `single`, `split`, `difference`, `other`. */
  compare(other, mode = other ? "split" : "single") {
    this.#other = other;
    this.#mode = mode;
    this.handle.hidden = mode !== "split" || !other;
    this.redraw();
  }

  set(options) {
    this.#options = { ...this.#options, ...options };
    this.redraw();
  }

  /** Draws at the next chance. */
  redraw() {
    if (this.#scheduled) return;
    this.#scheduled = true;
    requestAnimationFrame(() => {
      this.#scheduled = false;
      this.#draw();
    });
  }

  #draw() {
    const frame = this.#frame;
    if (!frame) return;
    const { canvas } = this;
    if (canvas.width !== frame.width || canvas.height !== frame.height) {
      canvas.width = frame.width;
      canvas.height = frame.height;
      this.#place();
    }
    const other = this.#other && this.#other.width === frame.width && this.#other.height === frame.height ? this.#other : null;
    const comparable = other && other.channels === frame.channels;
    const context = canvas.getContext("2d");
    const paint = (bytes, x0, x1) =>
      context.putImageData(new ImageData(bytes, frame.width, frame.height), 0, 0, x0, 0, x1 - x0, frame.height);
    if (comparable && this.#mode === "difference") {
      paint(developDifference(frame, other, this.#options), 0, frame.width);
    } else if (other && this.#mode === "other") {
      paint(develop(other, this.#options), 0, frame.width);
    } else {
      paint(develop(frame, this.#options), 0, frame.width);
      if (other && this.#mode === "split") paint(develop(other, this.#options), Math.round(this.#wipe * frame.width), frame.width);
    }
    canvas.dataset.drawn = String(Number(canvas.dataset.drawn ?? 0) + 1);
  }

  /** Puts the whole picture into view. */
  fit() {
    this.#fits = true;
    this.#place();
  }

  /** Zooms to so many screen pixels for a pixel of the picture, around a point of the host. */
  zoomTo(zoom, [x, y] = [this.host.clientWidth / 2, this.host.clientHeight / 2]) {
    const wanted = Math.min(MOST_ZOOM, Math.max(this.#fitting() / 2, zoom));
    const ratio = wanted / this.#zoom;
    this.#pan = [x - (x - this.#pan[0]) * ratio, y - (y - this.#pan[1]) * ratio];
    this.#zoom = wanted;
    this.#fits = false;
    this.#place();
  }

  panBy(dx, dy) {
    this.#pan = [this.#pan[0] + dx, this.#pan[1] + dy];
    this.#fits = false;
    this.#place();
  }

  #fitting() {
    const { clientWidth, clientHeight } = this.host;
    const { width, height } = this.#frame ?? this.canvas;
    return Math.min(clientWidth / width, clientHeight / height) || 1;
  }

  #place() {
    const { canvas, host } = this;
    const { width, height } = this.#frame ?? canvas;
    if (this.#fits) {
      this.#zoom = this.#fitting();
      this.#pan = [(host.clientWidth - width * this.#zoom) / 2, (host.clientHeight - height * this.#zoom) / 2];
    }
    canvas.style.width = `${width * this.#zoom}px`;
    canvas.style.height = `${height * this.#zoom}px`;
    canvas.style.transform = `translate(${this.#pan[0]}px, ${this.#pan[1]}px)`;
    canvas.classList.toggle("pixels", this.#zoom >= 2 && !this.#fits);
    this.handle.style.left = `${this.#pan[0]}px`;
    this.handle.style.width = `${width * this.#zoom}px`;
    this.dispatchEvent(new CustomEvent("zoom", { detail: this.#zoom }));
  }

  /** The pixel under a pointer, or null. */
  pixelAt(event) {
    const frame = this.#frame;
    if (!frame) return null;
    const box = this.canvas.getBoundingClientRect();
    const x = Math.floor(((event.clientX - box.left) / box.width) * frame.width);
    const y = Math.floor(((event.clientY - box.top) / box.height) * frame.height);
    if (x < 0 || y < 0 || x >= frame.width || y >= frame.height) return null;
    const values = (f) => Array.from(f.data.subarray((y * f.width + x) * f.channels, (y * f.width + x + 1) * f.channels));
    const other = this.#other && this.#other.width === frame.width && this.#other.height === frame.height ? values(this.#other) : null;
    return { x, y, values: values(frame), other };
  }

  #point(event) {
    this.dispatchEvent(new CustomEvent("pixel", { detail: this.pixelAt(event) }));
  }

  #listen() {
    const { host } = this;
    const pointers = new Map();
    host.addEventListener("wheel", (e) => {
      if (!this.interactive) return;
      e.preventDefault();
      const box = host.getBoundingClientRect();
      this.zoomTo(this.#zoom * 2 ** (-e.deltaY / 200), [e.clientX - box.left, e.clientY - box.top]);
    }, { passive: false });
    host.addEventListener("pointerdown", (e) => {
      if (!this.interactive || e.target === this.handle) return;
      host.setPointerCapture(e.pointerId);
      pointers.set(e.pointerId, [e.clientX, e.clientY]);
    });
    host.addEventListener("pointermove", (e) => {
      const at = pointers.get(e.pointerId);
      if (!at) return;
      this.panBy((e.clientX - at[0]) / pointers.size, (e.clientY - at[1]) / pointers.size);
      pointers.set(e.pointerId, [e.clientX, e.clientY]);
    });
    for (const type of ["pointerup", "pointercancel"]) host.addEventListener(type, (e) => pointers.delete(e.pointerId));
    host.addEventListener("dblclick", () => this.interactive && this.fit());
    host.addEventListener("keydown", (e) => {
      if (!this.interactive || e.target === this.handle || e.ctrlKey || e.metaKey || e.altKey) return;
      const step = 48;
      const moves = { ArrowLeft: [step, 0], ArrowRight: [-step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] };
      if (moves[e.key]) this.panBy(...moves[e.key]);
      else if (e.key === "+" || e.key === "=") this.zoomTo(this.#zoom * 1.5);
      else if (e.key === "-") this.zoomTo(this.#zoom / 1.5);
      else if (e.key === "0") this.fit();
      else if (e.key === "1") this.zoomTo(1);
      else return;
      e.preventDefault();
    });
  }
}
