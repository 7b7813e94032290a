// Pages about the whole farm: nodes, cost, log.

import { bytes, h, settled } from "../dom.js";
import { get } from "./api.js";
import { badge, bar, coreHours, field, money, pager, percent, put, Rows, toast, toggle, when } from "./ui.js";

export async function nodesPage(main, app) {
  const body = h("tbody");
  const dead = h("button", { type: "button", "aria-pressed": "false", onclick: () => {
    toggle(dead, dead.getAttribute("aria-pressed") !== "true");
    load();
  } }, "Show dead nodes");
  const nothing = h("p", { class: "nothing", hidden: true }, "There are no nodes. `etendue farm up` starts the farm.");
  const sum = h("p", { class: "soft", role: "status" });
  main.append(h("div", { class: "bar" }, h("h1", {}, "Nodes"), sum, h("span", { class: "space" }), dead),
    h("div", { class: "table-box" }, h("table", { id: "nodes" }, h("caption", { class: "visually-hidden" }, "Nodes"),
      h("thead", {}, h("tr", {}, ["Name", "State", "Load", "Memory", "Workers", "Running", "Units done", "Work", "Price", "Seen"].map((t) => h("th", { scope: "col" }, t)))), body)), nothing);
  const rows = new Rows(body, () => {
    const cells = Array.from({ length: 10 }, () => h("td"));
    const meter = (cell, share, text, label) => {
      if (!cell.firstChild) cell.replaceChildren(bar(0, "", label), h("span"));
      cell.firstChild.value = Math.min(1, share);
      cell.firstChild.className = share > 0.95 ? "full" : "";
      put(cell.lastChild, text);
    };
    return { element: h("tr", {}, cells), update: (n) => {
      put(cells[0], h("span", {}, h("strong", {}, n.name), h("small", { class: "soft" }, ` ${n.address}`)));
      put(cells[1], badge(n.state));
      meter(cells[2], n.cores ? n.load / n.cores : 0, `${n.load.toFixed(1)} of ${n.cores}`, `Load of ${n.name}`);
      meter(cells[3], n.memory_bytes ? n.memory_used_bytes / n.memory_bytes : 0, `${bytes(n.memory_used_bytes)} of ${bytes(n.memory_bytes)}`, `Memory of ${n.name}`);
      put(cells[4], n.workers);
      put(cells[5], n.running);
      put(cells[6], n.units_done.toLocaleString("en"));
      put(cells[7], coreHours(n.core_secs));
      put(cells[8], n.price ? `${money(n.price, app.status?.currency)} / core h` : "–");
      put(cells[9], when(n.seen_at));
    } };
  });
  async function load() {
    const all = dead.getAttribute("aria-pressed") === "true";
    const nodes = await get("/nodes", { alive: all ? null : true });
    rows.show(nodes);
    nothing.hidden = nodes.length > 0;
    const alive = nodes.filter((n) => n.state === "alive");
    const total = (f) => alive.reduce((s, n) => s + f(n), 0);
    sum.textContent = `${alive.length} alive, ${total((n) => n.cores)} cores, ${total((n) => n.running)} units running`;
  }
  await load();
  app.every(2000, () => load().catch(() => {}));
}

export async function costPage(main, app) {
  let by = "job";
  const kinds = { job: "By job", user: "By user", day: "By day" };
  const after = h("input", { type: "date", id: "after" });
  const before = h("input", { type: "date", id: "before" });
  const tabs = Object.entries(kinds).map(([key, text]) => h("button", { type: "button", "aria-pressed": String(key === by), onclick: (e) => {
    by = key;
    tabs.forEach((t) => toggle(t, t === e.currentTarget));
    load();
  } }, text));
  const body = h("tbody");
  const foot = h("tfoot");
  const head = h("th", { scope: "col" }, "Job");
  let rows = [];
  const save = h("button", { type: "button", onclick: () => {
    const quote = (v) => `"${String(v).replaceAll('"', '""').replace(/^([=+\-@\t\r])/, "'$1")}"`;
    const text = [["key", "jobs", "units", "core_secs", "cost"], ...rows.map((r) => [r.key, r.jobs, r.units, r.core_secs, r.cost])].map((r) => r.map((v, i) => (i ? v : quote(v))).join(",")).join("\r\n");
    const link = h("a", { href: URL.createObjectURL(new Blob([text], { type: "text/csv" })), download: `cost-by-${by}.csv` });
    link.click();
    URL.revokeObjectURL(link.href);
  } }, "Save as CSV");
  main.append(h("div", { class: "bar" }, h("h1", {}, "Cost"), h("div", { class: "row", role: "group", "aria-label": "Sum by" }, tabs), field("From", after), field("Until", before), h("span", { class: "space" }), save),
    h("div", { class: "table-box" }, h("table", { id: "cost" }, h("caption", { class: "visually-hidden" }, "Cost"),
      h("thead", {}, h("tr", {}, head, ["Jobs", "Units", "Work", "Cost", "Share"].map((t) => h("th", { scope: "col" }, t)))), body, foot)));
  async function load() {
    const day = (input, plus) => (input.value ? new Date(`${input.value}T00:00:00`).getTime() / 1000 + plus : null);
    rows = await get("/cost", { by, after: day(after, 0), before: day(before, 86400) });
    head.textContent = { job: "Job", user: "User", day: "Day" }[by];
    const weight = (r) => r.cost || r.core_secs;
    const most = Math.max(...rows.map(weight), 1e-9);
    const total = rows.reduce((s, r) => ({ jobs: s.jobs + r.jobs, units: s.units + r.units, core_secs: s.core_secs + r.core_secs, cost: s.cost + r.cost }), { jobs: 0, units: 0, core_secs: 0, cost: 0 });
    const currency = app.status?.currency;
    const name = (r) => {
      const [id, ...words] = r.key.split(" ");
      return by === "job" ? h("a", { href: `/jobs/${Number(id)}` }, `#${id} ${words.join(" ")}`) : r.key;
    };
    body.replaceChildren(...rows.slice(0, 1000).map((r) => h("tr", {}, h("td", {}, name(r)), h("td", {}, r.jobs), h("td", {}, r.units.toLocaleString("en")), h("td", {}, coreHours(r.core_secs)), h("td", {}, money(r.cost, currency)), h("td", {}, bar(weight(r) / most, "", `Share of ${r.key}`)))));
    foot.replaceChildren(h("tr", {}, h("th", { scope: "row" }, "All"), h("td", {}, total.jobs), h("td", {}, total.units.toLocaleString("en")), h("td", {}, coreHours(total.core_secs)), h("td", {}, money(total.cost, currency)), h("td")));
  }
  const changed = () => load().catch((e) => toast(e.message, { isError: true }));
  after.addEventListener("change", changed);
  before.addEventListener("change", changed);
  await load();
}

/** A list of log lines that can be narrowed by level; `query` says of what. */
export function logList(app, query) {
  const LIMIT = 100;
  let offset = 0;
  let levels = [];
  const body = h("tbody");
  const foot = h("div", { class: "foot" });
  const chips = ["info", "warning", "error", "audit"].map((level) => h("button", { type: "button", class: "chip", "aria-pressed": "false", onclick: (e) => {
    levels = levels.includes(level) ? levels.filter((l) => l !== level) : [...levels, level];
    toggle(e.currentTarget, levels.includes(level));
    offset = 0;
    load();
  } }, level));
  const rows = new Rows(body, () => {
    const cells = Array.from({ length: 5 }, () => h("td"));
    const element = h("tr", {}, cells);
    return { element, update: (e) => {
      element.className = `level-${e.level}`;
      put(cells[0], when(e.at));
      put(cells[1], e.level);
      put(cells[2], e.user ?? "");
      put(cells[3], [e.job_id ? `job ${e.job_id}` : "", e.frame !== null ? `frame ${e.frame}` : "", e.unit_id ? `unit ${e.unit_id}` : "", e.node ?? ""].filter(Boolean).join(", "));
      put(cells[4], e.message);
    } };
  });
  async function load() {
    try {
      const page = await get("/log", { ...query, level: levels, offset, limit: LIMIT });
      rows.show(page.items);
      foot.replaceChildren(pager({ offset, limit: LIMIT, total: page.total, go: (o) => {
        offset = o;
        load();
      } }));
    } catch (e) {
      if (e.status !== 401) toast(e.message, { isError: true });
    }
  }
  const element = h("div", {}, h("div", { class: "row chips", role: "group", "aria-label": "Levels" }, chips),
    h("div", { class: "table-box" }, h("table", { class: "log" }, h("caption", { class: "visually-hidden" }, "Log"), h("thead", {}, h("tr", {}, ["Time", "Level", "User", "Where", "What"].map((t) => h("th", { scope: "col" }, t)))), body)), foot);
  return { element, load };
}

export async function logPage(main, app) {
  const list = logList(app, {});
  main.append(h("div", { class: "bar" }, h("h1", {}, "Log"), h("p", { class: "soft" }, app.session.role === "admin" ? "Of the whole farm" : "What you have done")), list.element);
  await list.load();
  app.follow("", { jobs: settled(list.load, 300) });
}
