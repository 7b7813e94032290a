// Small helpers for pages. Text always goes in as text, never as markup, so that names cannot carry scripts.

/** An element with attributes, listeners (`onclick: f`) and children. */
export function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "class") element.className = value;
    else if (name === "value") element.value = value;
    else if (name === "dataset") Object.assign(element.dataset, value);
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.flat().filter((c) => c !== null && c !== undefined && c !== false));
  return element;
}

export const $ = (selector, from = document) => from.querySelector(selector);

/** A number in few digits. */
export function short(value, digits = 4) {
  if (value === null || value === undefined) return "–";
  if (!Number.isFinite(value)) return String(value);
  const a = Math.abs(value);
  if (a !== 0 && (a < 1e-3 || a >= 1e5)) return value.toExponential(2);
  return String(Number(value.toPrecision(digits)));
}

/** A time span in words. */
export function duration(secs) {
  if (secs === null || secs === undefined || !Number.isFinite(secs)) return "–";
  if (secs < 10) return `${secs.toFixed(1)} s`;
  if (secs < 60) return `${Math.round(secs)} s`;
  const s = Math.round(secs);
  const [hours, minutes] = [Math.floor(s / 3600), Math.floor((s % 3600) / 60)];
  return hours ? `${hours} h ${String(minutes).padStart(2, "0")} min` : `${minutes} min ${String(s % 60).padStart(2, "0")} s`;
}

/** A size in bytes in words. */
export function bytes(n) {
  if (n === null || n === undefined) return "–";
  const units = ["B", "kB", "MB", "GB", "TB"];
  let i = 0;
  while (n >= 1000 && i < units.length - 1) {
    n /= 1000;
    i++;
  }
  return `${i ? n.toFixed(1) : n} ${units[i]}`;
}

/** Calls `f` once things have been quiet for a while. */
export function settled(f, ms = 150) {
  let timer;
  return (...args) => {
    clearTimeout(timer);
    timer = setTimeout(() => f(...args), ms);
  };
}

/** Dark, light, or as the system says; kept in this browser. */
export function themeButton() {
  const names = { auto: "as the system", dark: "dark", light: "light" };
  const order = Object.keys(names);
  let theme = localStorage.getItem("etendue-theme") ?? "auto";
  const button = h("button", { type: "button", class: "quiet", id: "theme" });
  const apply = () => {
    document.documentElement.dataset.theme = theme;
    button.textContent = { auto: "◐", dark: "●", light: "○" }[theme];
    button.title = `Colors: ${names[theme]}`;
    button.setAttribute("aria-label", `Colors: ${names[theme]}. Change`);
  };
  button.addEventListener("click", () => {
    theme = order[(order.indexOf(theme) + 1) % order.length];
    localStorage.setItem("etendue-theme", theme);
    apply();
  });
  apply();
  return button;
}
