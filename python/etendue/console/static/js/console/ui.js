// What several pages show alike: states, times, progress, messages, questions, tables.

import { $, h } from "../dom.js";

export const STATES = ["waiting", "queued", "running", "paused", "approval", "done", "failed", "cancelled"];
const SIGNS = { waiting: "…", queued: "○", held: "◌", running: "▶", paused: "‖", approval: "!", done: "✓", failed: "✕", cancelled: "–", alive: "●", dead: "✕" };

/** A state as sign and word: color is never the only mark. */
export const badge = (state) => h("span", { class: `badge ${state}` }, h("span", { "aria-hidden": "true" }, SIGNS[state] ?? "·"), state);

export const toggle = (button, on) => button.setAttribute("aria-pressed", String(on));

/** A time as people say it, with the whole of it on hover. */
export function when(secs) {
  if (!secs) return h("span", { class: "soft" }, "–");
  const date = new Date(secs * 1000);
  const today = new Date();
  const isToday = date.toDateString() === today.toDateString();
  const text = isToday
    ? date.toLocaleTimeString([], { hour: "2-digit", minute: "2-digit", second: "2-digit" })
    : date.toLocaleString([], { year: date.getFullYear() === today.getFullYear() ? undefined : "numeric", month: "short", day: "numeric", hour: "2-digit", minute: "2-digit" });
  return h("time", { datetime: date.toISOString(), title: date.toLocaleString() }, text);
}

export const percent = (share) => `${share >= 0.9995 || share === 0 ? Math.round(100 * share) : (100 * share).toFixed(1)} %`;
export const coreHours = (secs) => (secs < 3600 ? `${(secs / 60).toFixed(1)} core min` : `${(secs / 3600).toFixed(2)} core h`);
export const money = (value, currency) => (value === null || value === undefined ? "–" : `${value.toFixed(value !== 0 && value < 1 ? 4 : 2)} ${currency ?? ""}`.trim());

export function bar(share, state, label) {
  const progress = h("progress", { max: "1", class: state, "aria-label": label });
  progress.value = share;
  return progress;
}

/** A sentence of the server with a capital, unless it begins with a file's name. */
export const sentence = (text) => (/^[a-z]+ /.test(text) ? text[0].toUpperCase() + text.slice(1) : text);

/** A message that goes away by itself; errors stay longer. */
export function toast(text, { isError = false } = {}) {
  const close = h("button", { type: "button", class: "quiet", "aria-label": "Close", onclick: () => box.remove() }, "✕");
  const box = h("div", { class: `toast${isError ? " error" : ""}`, role: isError ? "alert" : null }, h("p", {}, sentence(text)), close);
  $("#toasts").append(box);
  setTimeout(() => box.remove(), isError ? 12000 : 4000);
}

/** Does something and tells what the server says against it. Returns the result, or undefined. */
export async function attempt(work, done) {
  try {
    const result = await work();
    if (done) toast(done);
    return result ?? null;
  } catch (e) {
    if (e.name !== "AbortError") toast(e.message, { isError: true });
    return undefined;
  }
}

/** Asks a question in a dialog; resolves with the button's value, or null. `extra` is a field to show, if any. */
export function ask(title, text, buttons, extra = null) {
  return new Promise((resolve) => {
    const dialog = h("dialog", { "aria-labelledby": "dialog-title" },
      h("form", { method: "dialog" },
        h("h2", { id: "dialog-title" }, title),
        text ? h("p", {}, text) : null,
        extra,
        h("div", { class: "row end" }, buttons.map(([value, label, kind]) => h("button", { value, class: kind ?? "" }, label)))));
    dialog.addEventListener("close", () => {
      resolve(dialog.returnValue || null);
      dialog.remove();
    });
    document.body.append(dialog);
    dialog.showModal();
  });
}

export const confirmed = async (title, text, label) => (await ask(title, text, [["", "No"], ["yes", label, "main"]])) === "yes";

/** A labelled field. */
export const field = (label, control, hint) =>
  h("label", { class: "field" }, h("span", {}, label), control, hint ? h("small", { class: "soft" }, hint) : null);

export const check = (label, attributes = {}) => h("label", { class: "check" }, h("input", { type: "checkbox", ...attributes }), label);

/** A pager: offset, limit, total, go(offset). */
export function pager({ offset, limit, total, go }) {
  const last = Math.min(offset + limit, total);
  return h("nav", { class: "pager", "aria-label": "Pages of the list" },
    h("button", { type: "button", disabled: offset === 0, onclick: () => go(Math.max(0, offset - limit)), "aria-label": "Earlier rows" }, "‹"),
    h("span", {}, total ? `${offset + 1}–${last} of ${total.toLocaleString("en")}` : "none"),
    h("button", { type: "button", disabled: last >= total, onclick: () => go(offset + limit), "aria-label": "Later rows" }, "›"));
}

/** The losses and warnings of reading a scene. */
export function lossReport(info) {
  const place = (row) => `${row[0]}${row[1] ? `:${row[1]}` : ""}`;
  const losses = info.losses ?? [];
  const warnings = info.warnings ?? [];
  if (!losses.length && !warnings.length) return h("p", { class: "good-note" }, "✓ Everything in this scene is honored.");
  return h("div", { class: "losses" },
    losses.length ? h("h3", {}, `Not honored (${losses.length})`) : null,
    losses.length ? h("ul", {}, losses.map((l) => h("li", {}, h("code", {}, place(l)), ` ${l[3]}: ${l[4]}`))) : null,
    warnings.length ? h("h3", {}, `Warnings (${warnings.length})`) : null,
    warnings.length ? h("ul", {}, warnings.map((w) => h("li", {}, h("code", {}, place(w)), ` ${w[4]}`))) : null);
}

/** Rows of a table that are kept by key and changed in place, so that focus and selection stay where they are. */
export class Rows {
  constructor(body, make) {
    this.body = body;
    this.make = make;
    this.rows = new Map();
  }

  show(items, key = (item) => item.id) {
    const old = this.rows;
    this.rows = new Map();
    items.forEach((item, i) => {
      const k = key(item);
      const row = old.get(k) ?? this.make(item);
      old.delete(k);
      row.update(item);
      row.item = item;
      this.rows.set(k, row);
      if (this.body.children[i] !== row.element) this.body.insertBefore(row.element, this.body.children[i] ?? null);
    });
    for (const row of old.values()) row.element.remove();
  }
}

/** Puts text or an element into a cell only where it has changed. */
export function put(cell, value) {
  if (value instanceof Node) {
    if (cell.innerHTML !== value.outerHTML) cell.replaceChildren(value);
  } else if (cell.textContent !== String(value)) cell.textContent = String(value);
}
