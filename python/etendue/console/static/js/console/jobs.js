// The table of jobs. Filters, order and page are in the address, so that it can be kept and sent.

import { h, settled } from "../dom.js";
import { API, get, post } from "./api.js";
import { attempt, badge, bar, coreHours, confirmed, money, pager, percent, put, Rows, STATES, toast, toggle, when } from "./ui.js";

const COLUMNS = [
  ["name", "Name"],
  ["owner", "Owner"],
  ["state", "State"],
  ["frames", "Frames"],
  ["progress", "Progress"],
  ["priority", "Priority"],
  ["created", "Submitted"],
  ["started", "Started"],
  ["finished", "Finished"],
  ["cost", "Cost"],
];
const LIMIT = 50;
const PER_BATCH = { cancel: "Cancel", pause: "Pause", resume: "Resume", retry: "Retry", delete: "Delete" };

export async function jobsPage(main, app) {
  const address = new URLSearchParams(location.search);
  const filter = {
    q: address.get("q") ?? "",
    owner: address.get("owner") ?? "",
    state: address.getAll("state"),
    order: address.get("order") ?? "created",
    down: address.get("down") !== "false",
    offset: Number(address.get("offset") ?? 0),
  };
  const chosen = new Set();
  let page = { items: [], total: 0 };
  let asking = null;

  const search = h("input", { type: "search", id: "search", placeholder: "Name or scene", "aria-label": "Name or scene", value: filter.q });
  const mine = h("button", { type: "button", id: "mine" }, "Only mine");
  const chips = STATES.map((state) => h("button", { type: "button", class: "chip", dataset: { state }, onclick: () => {
    filter.state = filter.state.includes(state) ? filter.state.filter((s) => s !== state) : [...filter.state, state];
    changed();
  } }, state));
  const batch = h("div", { class: "row batch", hidden: true });
  const heads = COLUMNS.map(([key, text]) => h("th", { scope: "col", dataset: { key } }, h("button", { type: "button", class: "sort", onclick: () => {
    filter.down = filter.order === key ? !filter.down : !["name", "owner", "state"].includes(key);
    filter.order = key;
    changed();
  } }, text)));
  const all = h("input", { type: "checkbox", "aria-label": "Choose all rows", onchange: () => {
    for (const job of page.items) all.checked ? chosen.add(job.id) : chosen.delete(job.id);
    render();
  } });
  const body = h("tbody");
  const foot = h("div", { class: "foot" });
  const nothing = h("p", { class: "nothing", hidden: true });
  main.append(
    h("div", { class: "bar" }, h("h1", {}, "Jobs"), search, mine, h("div", { class: "row chips", role: "group", "aria-label": "States" }, chips), h("span", { class: "space" }), app.session.role === "viewer" ? null : h("a", { class: "button main", href: "/submit" }, "Submit a job")),
    batch,
    h("div", { class: "table-box" }, h("table", { id: "jobs" }, h("caption", { class: "visually-hidden" }, "Jobs"),
      h("thead", {}, h("tr", {}, h("th", { class: "tick" }, all), h("th", {}, h("span", { class: "visually-hidden" }, "Preview")), heads)), body)),
    nothing, foot,
  );

  const rows = new Rows(body, (job) => {
    const tick = h("input", { type: "checkbox", "aria-label": `Choose ${job.name}`, onchange: () => {
      tick.checked ? chosen.add(job.id) : chosen.delete(job.id);
      render();
    } });
    const image = h("img", { class: "thumb", alt: "", width: "72", height: "40", hidden: true });
    image.addEventListener("load", () => (image.hidden = false));
    image.addEventListener("error", () => (image.hidden = true));
    const link = h("a", { href: `/jobs/${job.id}`, class: "name" });
    const scene = h("small", { class: "soft" });
    const cells = Object.fromEntries(COLUMNS.slice(1).map(([key]) => [key, h("td", { class: key })]));
    const element = h("tr", { dataset: { id: job.id }, tabindex: "-1" }, h("td", { class: "tick" }, tick), h("td", { class: "preview" }, image), h("td", {}, link, scene), Object.values(cells));
    element.addEventListener("click", (e) => {
      if (!e.target.closest("a, input, button") && !String(getSelection())) app.go(`/jobs/${job.id}`);
    });
    let shown = -1;
    const update = (j) => {
      put(link, j.name);
      put(scene, `#${j.id} ${j.scene}`);
      tick.checked = chosen.has(j.id);
      element.classList.toggle("chosen", tick.checked);
      put(cells.owner, j.owner);
      put(cells.state, badge(j.state));
      put(cells.frames, `${j.frames_done} / ${j.frames_total}${j.frames_failed ? `, ${j.frames_failed} failed` : ""}`);
      const meter = cells.progress.querySelector("progress");
      if (meter) {
        meter.value = j.progress;
        meter.className = j.state;
        put(cells.progress.lastChild, percent(j.progress));
      } else cells.progress.replaceChildren(bar(j.progress, j.state, `Progress of ${j.name}`), h("span", {}, percent(j.progress)));
      put(cells.priority, j.priority);
      put(cells.created, when(j.created_at));
      put(cells.started, when(j.started_at));
      put(cells.finished, j.finished_at ? when(j.finished_at) : j.estimated_end_at ? h("span", { class: "soft", title: "If it goes on like this" }, "≈ ", when(j.estimated_end_at)) : when(null));
      put(cells.cost, j.cost > 0 ? money(j.cost, app.status?.currency) : coreHours(j.core_secs));
      cells.cost.title = coreHours(j.core_secs);
      if (shown !== j.version && j.units_done > 0) {
        shown = j.version;
        image.src = `${API}/jobs/${j.id}/preview?v=${j.version}`;
      }
    };
    return { element, update };
  });

  function render() {
    rows.show(page.items);
    heads.forEach((th) => {
      if (th.dataset.key === filter.order) th.setAttribute("aria-sort", filter.down ? "descending" : "ascending");
      else th.removeAttribute("aria-sort");
    });
    chips.forEach((c) => toggle(c, filter.state.includes(c.dataset.state)));
    toggle(mine, filter.owner === app.session.name);
    all.checked = page.items.length > 0 && page.items.every((j) => chosen.has(j.id));
    all.indeterminate = !all.checked && page.items.some((j) => chosen.has(j.id));
    nothing.hidden = page.items.length > 0;
    nothing.textContent = filter.q || filter.owner || filter.state.length ? "No job fits these filters." : "There are no jobs yet. Submit one: drop a scene on the page “Submit”.";
    foot.replaceChildren(pager({ offset: filter.offset, limit: LIMIT, total: page.total, go: (offset) => {
      filter.offset = offset;
      load();
    } }));
    batch.hidden = chosen.size === 0;
    batch.replaceChildren(h("span", {}, `${chosen.size} chosen`), ...Object.entries(PER_BATCH).map(([action, text]) => h("button", { type: "button", onclick: () => act(action, [...chosen]) }, text)),
      h("button", { type: "button", class: "quiet", onclick: () => { chosen.clear(); render(); } }, "None"));
  }

  async function load() {
    asking?.abort();
    asking = new AbortController();
    const query = { ...filter, limit: LIMIT };
    const kept = new URLSearchParams();
    if (filter.q) kept.set("q", filter.q);
    if (filter.owner) kept.set("owner", filter.owner);
    for (const s of filter.state) kept.append("state", s);
    if (filter.order !== "created") kept.set("order", filter.order);
    if (!filter.down) kept.set("down", "false");
    if (filter.offset) kept.set("offset", filter.offset);
    app.replace(kept.size ? `/?${kept}` : "/");
    try {
      page = await get("/jobs", query, asking.signal);
    } catch (e) {
      if (e.name !== "AbortError" && e.status !== 401) toast(e.message, { isError: true });
      return;
    }
    render();
    document.body.dataset.loaded = "jobs";
  }
  const changed = () => {
    filter.offset = 0;
    load();
  };

  async function act(action, ids) {
    if (!ids.length) return;
    const many = ids.length === 1 ? "this job" : `${ids.length} jobs`;
    if (action === "delete" && !(await confirmed(`Delete ${many}?`, "Their pictures go as well. This cannot be taken back.", "Delete"))) return;
    if (action === "cancel" && !(await confirmed(`Cancel ${many}?`, "What is done stays; “Retry” goes on with it.", "Cancel the rendering"))) return;
    const result = await attempt(() => post("/jobs/batch", { action, jobs: ids }));
    if (!result) return;
    for (const fault of result.refused.slice(0, 3)) toast(fault.message, { isError: true });
    if (result.done.length) toast(`${PER_BATCH[action] ?? action}: ${result.done.length} job${result.done.length === 1 ? "" : "s"}`);
    chosen.clear();
    load();
  }

  search.addEventListener("input", settled(() => {
    filter.q = search.value.trim();
    changed();
  }, 200));
  mine.addEventListener("click", () => {
    filter.owner = filter.owner ? "" : app.session.name;
    changed();
  });
  const focused = () => document.activeElement?.closest("#jobs tbody tr");
  const step = (n) => {
    const list = [...body.children];
    const row = list[Math.max(0, Math.min(list.length - 1, list.indexOf(focused()) + n))];
    row?.focus();
    row?.scrollIntoView({ block: "nearest" });
  };
  const here = () => {
    const row = focused();
    return row ? [Number(row.dataset.id)] : [...chosen];
  };
  app.keys = {
    "/": () => search.focus(),
    j: () => step(1),
    k: () => step(-1),
    ArrowDown: () => step(1),
    ArrowUp: () => step(-1),
    Enter: (e) => {
      const row = focused();
      if (row && e.target === row) app.go(`/jobs/${row.dataset.id}`);
    },
    x: () => focused()?.querySelector("input").click(),
    c: () => act("cancel", here()),
    p: () => {
      const job = page.items.find((j) => j.id === here()[0]);
      act(job?.state === "paused" ? "resume" : "pause", here());
    },
    r: () => act("retry", here()),
    n: () => app.go("/submit"),
  };
  await load();
  const refresh = settled(load, 100);
  app.follow("", { jobs: () => !document.hidden && refresh() });
}
