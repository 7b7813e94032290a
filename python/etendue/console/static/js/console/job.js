// One job: its picture as it sharpens, its frames, units, files and log.

import { $, bytes, duration, h, settled, short } from "../dom.js";
import { decode, Picture } from "../picture.js";
import { OPERATOR_NAMES } from "../tone.js";
import { API, call, get, post, request } from "./api.js";
import { logList } from "./farm.js";
import { ask, attempt, badge, bar, coreHours, confirmed, field, lossReport, money, pager, percent, put, Rows, sentence, toggle, when } from "./ui.js";

const ACTIONS = { pause: "Pause", resume: "Resume", approve: "Approve", retry: "Retry", cancel: "Cancel", delete: "Delete" };
const FRAMES = 60;

export async function jobPage(main, app, id) {
  let job = await get(`/jobs/${id}`);
  document.title = `${job.name} – Etendue farm`;
  const url = new URLSearchParams(location.search);
  const first = await get(`/jobs/${id}/frames`, { limit: 1 });
  let frame = url.has("frame") ? Number(url.get("frame")) : (first.items[0]?.number ?? 0);
  let frames = { items: [], total: 0 };
  let framesOffset = 0;

  // ------------------------------------------------------------------------------------------------------------- picture
  const stage = h("div", { id: "stage", class: "stage", tabindex: "0" });
  const picture = new Picture(stage, { label: `Frame ${frame} of ${job.name}` });
  const empty = h("p", { class: "waiting" }, "No unit is done yet.");
  stage.append(empty);
  let layer = "rgb";
  let isFull = false;
  let etag = null;
  let before = null;
  let pinned = null;
  let mode = "off";
  let asking = null;

  const layerSelect = h("select", { id: "layer", onchange: () => setLayer(layerSelect.value) }, h("option", {}, "rgb"));
  const exposure = h("input", { id: "exposure", type: "range", min: "-8", max: "8", step: "0.1", value: "0" });
  const stops = h("output", { for: "exposure" }, "0 stops");
  const operator = h("select", { id: "operator", onchange: () => picture.set({ operator: operator.value }) }, OPERATOR_NAMES.map((o) => h("option", {}, o)));
  const compare = h("select", { id: "compare", onchange: () => setMode(compare.value) }, [["off", "no comparison"], ["split", "split"], ["difference", "difference"], ["other", "only the other"]].map(([v, t]) => h("option", { value: v }, t)));
  const pin = h("button", { type: "button", id: "pin", title: "Compare with this picture from now on", "aria-pressed": "false", onclick: () => {
    pinned = pinned ? null : picture.frame;
    toggle(pin, Boolean(pinned));
    if (pinned && mode === "off") setMode("split");
    else setMode(mode);
  } }, "Pin");
  const full = h("button", { type: "button", title: "All pixels, not a smaller copy", "aria-pressed": "false", onclick: () => {
    isFull = !isFull;
    toggle(full, isFull);
    etag = null;
    load();
  } }, "All pixels");
  const zoom = h("span", { class: "soft mono" });
  const pixel = h("span", { class: "mono soft pixel", "aria-hidden": "true" }, " ");
  const version = h("span", { class: "soft", id: "version", role: "status" });
  const setExposure = (v) => {
    const value = Math.max(-8, Math.min(8, Math.round(v * 10) / 10));
    exposure.value = String(value);
    stops.textContent = `${value > 0 ? "+" : ""}${value} stops`;
    picture.set({ exposure: value });
  };
  exposure.addEventListener("input", () => setExposure(Number(exposure.value)));
  function setLayer(name) {
    layer = name;
    layerSelect.value = name;
    etag = null;
    before = pinned = null;
    toggle(pin, false);
    setMode("off");
    load();
  }
  function setMode(m) {
    const other = pinned ?? before;
    mode = m;
    compare.value = m;
    picture.compare(m === "off" ? null : other, m === "off" ? "single" : m);
    if (m !== "off" && !other) version.textContent = "There is no earlier version yet; it comes with the next units.";
  }
  picture.addEventListener("zoom", ({ detail }) => (zoom.textContent = picture.frame ? `${Math.round(100 * detail)} %` : ""));
  picture.addEventListener("pixel", ({ detail }) => {
    const text = (values) => values.map((v) => short(v)).join("  ");
    pixel.textContent = detail ? `${detail.x}, ${detail.y}: ${text(detail.values)}${detail.other ? `  |  ${text(detail.other)}` : ""}` : " ";
  });

  async function load() {
    asking?.abort();
    asking = new AbortController();
    const { signal } = asking;
    try {
      const response = await request("GET", `/jobs/${id}/frames/${frame}/layers/${encodeURIComponent(layer)}`, {
        query: { size: isFull ? 4096 : 1600 },
        headers: etag ? { "If-None-Match": etag } : {},
        signal,
      });
      if (response.status === 304) return;
      if (response.status === 204) {
        empty.hidden = Boolean(picture.frame) && picture.frame.frame === frame;
        return;
      }
      const next = decode(await response.arrayBuffer());
      if (signal.aborted) return;
      // Only now: a picture cut off half way is not here, and "not changed" would leave it out for good.
      etag = response.headers.get("ETag");
      const now = picture.frame;
      if (now && now.frame === next.frame && now.layer === next.layer && now.width === next.width && now.version !== next.version) before = now;
      if (now && now.frame !== next.frame) before = null;
      empty.hidden = true;
      saveShown.disabled = false;
      picture.show(next);
      if (mode !== "off") picture.compare(pinned ?? before, mode);
      if (layerSelect.options.length !== next.layers.length) layerSelect.replaceChildren(...next.layers.map((l) => h("option", {}, l)));
      layerSelect.value = layer;
      version.textContent = `version ${next.version}, ${next.width} × ${next.height}`;
      stage.dataset.version = String(next.version);
    } catch (e) {
      if (e.name === "AbortError" || e.status === 401) return;
      version.textContent = sentence(e.message);
    }
  }
  function goTo(number) {
    frame = number;
    etag = null;
    pinned = before = null;
    toggle(pin, false);
    setMode("off");
    picture.label = `Frame ${frame} of ${job.name}`;
    app.replace(`/jobs/${id}?frame=${frame}`);
    put(frameLabel, job.kind === "still" ? "Still" : `Frame ${frame}`);
    grid.querySelectorAll("[aria-current]").forEach((e) => e.removeAttribute("aria-current"));
    grid.querySelector(`[data-frame="${frame}"]`)?.setAttribute("aria-current", "true");
    load();
    if (tab === "units") loadUnits();
  }
  async function step(n) {
    const numbers = frames.items.map((f) => f.number);
    const next = numbers[numbers.indexOf(frame) + n];
    if (next !== undefined) goTo(next);
    else if (n > 0 && framesOffset + FRAMES < frames.total) {
      framesOffset += FRAMES;
      await loadFrames();
      goTo(frames.items[0].number);
    } else if (n < 0 && framesOffset > 0) {
      framesOffset = Math.max(0, framesOffset - FRAMES);
      await loadFrames();
      goTo(frames.items.at(-1).number);
    }
  }

  // --------------------------------------------------------------------------------------------------------------- facts
  const title = h("h1", {}, job.name);
  const state = h("span", { id: "state" });
  const meter = bar(0, "", "Progress");
  const share = h("span", { id: "progress" });
  const facts = h("dl");
  const fault = h("p", { class: "fault", role: "alert", hidden: true });
  const actions = h("div", { class: "row", id: "actions" });
  const frameLabel = h("strong");
  const downloads = h("div", { class: "row", id: "downloads" });
  function tell() {
    put(title, job.name);
    put(state, badge(job.state));
    meter.value = job.progress;
    meter.className = job.state;
    put(share, percent(job.progress));
    fault.hidden = !job.error;
    put(fault, job.error ?? "");
    const currency = app.status?.currency;
    const rows = [
      ["Owner", job.owner + (job.is_shared ? " (everyone may look)" : "")],
      ["Scene", job.scene],
      ["Frames", `${job.frames_done} of ${job.frames_total}${job.frames_failed ? `, ${job.frames_failed} failed` : ""}`],
      ["Units", `${job.units_done} of ${job.units_total}${job.units_failed ? `, ${job.units_failed} failed` : ""}`],
      ["Submitted", when(job.created_at)],
      ["Started", when(job.started_at)],
      [job.finished_at ? "Finished" : "Will end", job.finished_at ? when(job.finished_at) : job.estimated_end_at ? h("span", {}, "≈ ", when(job.estimated_end_at)) : "–"],
      ["Work", `${coreHours(job.core_secs)}${job.estimated_core_secs ? ` of about ${coreHours(job.estimated_core_secs)}` : ""}`],
      ["Cost", `${money(job.cost, currency)}${job.estimated_cost ? ` of about ${money(job.estimated_cost, currency)}` : ""}`],
      ["Priority", String(job.priority)],
      ...(job.needs.length ? [["Waits for", h("span", {}, job.needs.map((n, i) => [i ? ", " : "", h("a", { href: `/jobs/${n}` }, `#${n}`)]).flat())]] : []),
    ];
    facts.replaceChildren(...rows.flatMap(([k, v]) => [h("dt", {}, k), h("dd", {}, v)]));
    const wanted = job.actions.join();
    if (actions.dataset.for !== wanted) {
      actions.dataset.for = wanted;
      actions.replaceChildren(
        ...job.actions.filter((a) => ACTIONS[a]).map((a) => h("button", { type: "button", id: `do-${a}`, class: a === "approve" ? "main" : ["cancel", "delete"].includes(a) ? "bad" : "", onclick: () => act(a) }, ACTIONS[a])),
        job.actions.includes("priority") ? h("button", { type: "button", id: "do-priority", onclick: setPriority }, "Priority …") : "",
        app.session.role === "viewer" ? "" : h("a", { class: "button", href: `/submit?package=${job.package_id}&like=${job.id}` }, "Submit again …"));
    }
    put(frameLabel, job.kind === "still" ? "Still" : `Frame ${frame}`);
    const key = `${job.frames_done}`;
    if (downloads.dataset.for !== key) {
      downloads.dataset.for = key;
      loadFiles();
    }
    document.body.dataset.state = job.state;
  }
  async function act(action) {
    if (action === "cancel" && !(await confirmed("Cancel this job?", "What is done stays; “Retry” goes on with it.", "Cancel the rendering"))) return;
    if (action === "delete") {
      if (!(await confirmed("Delete this job?", "Its pictures go as well. This cannot be taken back.", "Delete"))) return;
      if ((await attempt(() => call("DELETE", `/jobs/${id}`), "Deleted")) !== undefined) app.go("/");
      return;
    }
    const changed = await attempt(() => post(`/jobs/${id}/${action}`));
    if (!changed) return;
    job = changed;
    tell();
    loadFrames();
  }
  async function setPriority() {
    const input = h("input", { type: "number", min: "-100", max: "100", value: String(job.priority), id: "priority" });
    if ((await ask("Priority", "Jobs of higher priority go first, from −100 to 100.", [["", "Leave"], ["yes", "Set", "main"]], field("Priority", input))) !== "yes") return;
    const changed = await attempt(() => call("PUT", `/jobs/${id}/priority`, { body: { priority: Number(input.value) } }));
    if (changed) {
      job = changed;
      tell();
    }
  }

  // --------------------------------------------------------------------------------------------------------------- tabs
  const grid = h("ol", { class: "grid", id: "frames" });
  const gridFoot = h("div", { class: "foot" });
  const cards = new Rows(grid, (f) => {
    const image = h("img", { alt: "", width: "160", height: "90", hidden: true });
    image.addEventListener("load", () => (image.hidden = false));
    const mark = h("span", { class: "mark" });
    const meter = h("progress", { max: "1", "aria-label": `Progress of frame ${f.number}` });
    const element = h("li", {}, h("button", { type: "button", class: "frame", dataset: { frame: f.number }, onclick: () => goTo(f.number) }, h("span", { class: "image" }, image), h("span", { class: "label" }, f.number, mark), meter));
    let shown = 0;
    return { element, update: (now) => {
      const button = element.firstChild;
      button.setAttribute("aria-label", `Frame ${now.number}, ${now.state}${now.error ? `: ${now.error}` : ""}`);
      button.title = now.error ?? `${now.spp_done}${now.spp_target ? ` of ${now.spp_target}` : ""} spp${now.relative_error !== null ? `, error ${(100 * now.relative_error).toFixed(1)} %` : ""}`;
      if (now.number === frame) button.setAttribute("aria-current", "true");
      put(mark, badge(now.state));
      meter.value = now.state === "done" ? 1 : now.units_total ? now.units_done / now.units_total : 0;
      meter.className = now.state;
      if (now.preview_version > shown) {
        shown = now.preview_version;
        image.src = `${API}/jobs/${id}/frames/${now.number}/preview?v=${shown}`;
      }
    } };
  });
  async function loadFrames() {
    frames = await get(`/jobs/${id}/frames`, { offset: framesOffset, limit: FRAMES });
    cards.show(frames.items, (f) => f.number);
    gridFoot.replaceChildren(frames.total > FRAMES ? pager({ offset: framesOffset, limit: FRAMES, total: frames.total, go: (o) => {
      framesOffset = o;
      loadFrames();
    } }) : "");
  }

  const unitBody = h("tbody");
  const unitFoot = h("div", { class: "foot" });
  let unitOffset = 0;
  let onlyFrame = false;
  let onlyFailed = false;
  const UNITS = 50;
  const unitRows = new Rows(unitBody, (u) => {
    const cells = Array.from({ length: 9 }, () => h("td"));
    const element = h("tr", { dataset: { unit: u.id } }, cells);
    return { element, update: (now) => {
      const [x0, y0, x1, y1] = now.rect;
      put(cells[0], `#${now.id}`);
      put(cells[1], now.frame);
      put(cells[2], now.kind === "probe" ? "probe" : `${x0},${y0} – ${x1},${y1}`);
      put(cells[3], now.kind === "probe" ? "" : `${now.begin}–${now.end}`);
      put(cells[4], badge(now.state));
      put(cells[5], now.node ?? "");
      put(cells[6], now.secs === null ? (now.estimated_secs ? `≈ ${duration(now.estimated_secs)}` : "") : duration(now.secs));
      put(cells[7], `${now.attempts}${now.losses ? ` (${now.losses} lost)` : ""}`);
      const has = now.error || now.log;
      const key = `${now.error}|${now.log}|${now.state}`;
      if (cells[8].dataset.key === key) return;
      cells[8].dataset.key = key;
      const again = now.state === "failed" && job.actions.includes("retry") ? h("button", { type: "button", onclick: async () => {
        if (await attempt(() => post(`/jobs/${id}/units/${now.id}/retry`), "Tried again")) loadUnits();
      } }, "Retry") : null;
      cells[8].replaceChildren(has ? h("details", {}, h("summary", {}, now.error ? "Error" : "Log"), now.error ? h("pre", { class: "fault" }, now.error) : "", now.log ? h("pre", {}, now.log) : "") : "", again ?? "");
    } };
  });
  async function loadUnits() {
    const query = { offset: unitOffset, limit: UNITS, frame: onlyFrame ? frame : null, state: onlyFailed ? ["failed"] : [] };
    const page = await get(`/jobs/${id}/units`, query);
    unitRows.show(page.items);
    unitFoot.replaceChildren(pager({ offset: unitOffset, limit: UNITS, total: page.total, go: (o) => {
      unitOffset = o;
      loadUnits();
    } }));
  }
  const narrow = (text, set) => {
    const button = h("button", { type: "button", class: "chip", "aria-pressed": "false", onclick: () => {
      const on = button.getAttribute("aria-pressed") !== "true";
      toggle(button, on);
      set(on);
      unitOffset = 0;
      loadUnits();
    } }, text);
    return button;
  };
  const units = h("div", {}, h("div", { class: "row chips" }, narrow("Only this frame", (on) => (onlyFrame = on)), narrow("Only failed", (on) => (onlyFailed = on))),
    h("div", { class: "table-box" }, h("table", { id: "units" }, h("caption", { class: "visually-hidden" }, "Units"), h("thead", {}, h("tr", {}, ["Unit", "Frame", "Pixels", "Samples", "State", "Node", "Time", "Attempts", "Told"].map((t) => h("th", { scope: "col" }, t)))), unitBody)), unitFoot);

  const fileBody = h("tbody");
  // Made once: the picture may come before the list of files, or after it.
  const saveShown = h("button", { type: "button", id: "save-png", disabled: true, onclick: savePng, title: "As it is shown here" }, "PNG as shown");
  const fps = h("input", { type: "number", id: "fps", min: "1", max: "120", value: "24" });
  async function loadFiles() {
    const files = await get(`/jobs/${id}/outputs`);
    const link = (f, text) => h("a", { href: `${API}/jobs/${id}/outputs/${f.name.split("/").map(encodeURIComponent).join("/")}`, download: "" }, text);
    fileBody.replaceChildren(...files.slice(0, 2000).map((f) => h("tr", {}, h("td", {}, link(f, f.name)), h("td", {}, f.frame), h("td", {}, bytes(f.bytes)), h("td", { class: "mono soft" }, f.sha256.slice(0, 16)))));
    const own = files.filter((f) => f.frame === frame);
    downloads.replaceChildren(
      ...own.map((f) => {
        const a = link(f, f.format.toUpperCase());
        a.className = "button";
        return a;
      }),
      saveShown,
      files.length > 1 ? h("a", { class: "button", id: "zip", href: `${API}/jobs/${id}/outputs.zip`, download: "" }, `All ${files.length} files (zip)`) : "",
      job.kind === "animation" && job.frames_done > 0 ? h("button", { type: "button", id: "movie", onclick: saveMovie }, "Film (MP4)") : "");
    filesNothing.hidden = files.length > 0;
  }
  const saveBy = (href) => {
    const a = h("a", { href, download: "" });
    document.body.append(a);
    a.click();
    a.remove();
  };
  const shown = () => ({ exposure: String(picture.options.exposure), tonemap: picture.options.operator });
  function savePng() {
    saveBy(`${API}/jobs/${id}/frames/${frame}/picture?${new URLSearchParams({ layer, ...shown(), download: "true" })}`);
  }
  async function saveMovie() {
    if ((await ask("Film of the finished frames", "H.264 in an MP4 file, with exposure and tone mapping as shown here.", [["", "Leave"], ["yes", "Make it", "main"]], field("Frames a second", fps))) !== "yes") return;
    saveBy(`${API}/jobs/${id}/movie.mp4?${new URLSearchParams({ fps: fps.value, ...shown() })}`);
  }
  const filesNothing = h("p", { class: "nothing" }, "Files come when frames are done.");
  const filesTab = h("div", {}, h("div", { class: "table-box" }, h("table", { id: "files" }, h("caption", { class: "visually-hidden" }, "Files"), h("thead", {}, h("tr", {}, ["File", "Frame", "Size", "SHA-256"].map((t) => h("th", { scope: "col" }, t)))), fileBody)), filesNothing);

  const log = logList(app, { job: id });
  const scene = h("div", {});
  async function loadScene() {
    const parts = [h("h3", {}, "Order"), h("pre", {}, JSON.stringify(job.spec, (k, v) => (v === null || (Array.isArray(v) && !v.length) || (v && typeof v === "object" && !Array.isArray(v) && !Object.keys(v).length) ? undefined : v), 2))];
    try {
      const found = await get(`/packages/${job.package_id}`);
      parts.unshift(h("h3", {}, "Reading the scene"), lossReport(found.info), h("h3", {}, `Files (${found.files.length})`), h("ul", { class: "plain" }, found.files.slice(0, 200).map((f) => h("li", {}, f[0], h("span", { class: "soft" }, ` ${bytes(f[1])}`)))));
    } catch {
      // The package belongs to someone else.
    }
    scene.replaceChildren(...parts);
  }
  let tab = "frames";
  const TABS = { frames: ["Frames", h("div", {}, grid, gridFoot), loadFrames], units: ["Units", units, loadUnits], files: ["Files", filesTab, loadFiles], log: ["Log", log.element, log.load], scene: ["Scene", scene, loadScene] };
  const tabs = Object.entries(TABS).map(([key, [text]]) => h("button", { type: "button", role: "tab", id: `tab-${key}`, "aria-controls": `panel-${key}`, onclick: () => open(key) }, text));
  const panels = Object.entries(TABS).map(([key, [, element]]) => h("div", { role: "tabpanel", id: `panel-${key}`, "aria-labelledby": `tab-${key}`, hidden: true }, element));
  function open(key) {
    tab = key;
    tabs.forEach((t) => {
      const on = t.id === `tab-${key}`;
      t.setAttribute("aria-selected", String(on));
      t.tabIndex = on ? 0 : -1;
    });
    panels.forEach((p) => (p.hidden = p.id !== `panel-${key}`));
    attempt(TABS[key][2]);
  }
  const tablist = h("div", { role: "tablist", class: "tabs", "aria-label": "Parts of the job", onkeydown: (e) => {
    const move = { ArrowLeft: -1, ArrowRight: 1 }[e.key];
    if (!move) return;
    e.stopPropagation();
    const keys = Object.keys(TABS);
    open(keys[(keys.indexOf(tab) + move + keys.length) % keys.length]);
    $(`#tab-${tab}`).focus();
  } }, tabs);

  main.append(
    h("div", { class: "bar" }, h("a", { href: "/", class: "button quiet" }, "‹ Jobs"), title, state, h("div", { class: "meter" }, meter, share), h("span", { class: "space" }), actions),
    fault,
    h("div", { class: "job" },
      h("section", { class: "viewer-box", "aria-label": "Picture" },
        h("div", { class: "tools" }, frameLabel, field("Layer", layerSelect), h("label", { class: "field", for: "exposure" }, h("span", {}, "Exposure ", stops), exposure), field("Tone mapping", operator), field("Compare", compare), pin, full,
          h("button", { type: "button", onclick: () => picture.fit() }, "Fit"), h("button", { type: "button", onclick: () => picture.zoomTo(1) }, "1:1")),
        stage,
        h("div", { class: "under" }, zoom, pixel, h("span", { class: "space" }), version)),
      h("aside", { class: "card facts", "aria-label": "Facts" }, facts, h("h2", {}, "Download"), downloads)),
    tablist, ...panels,
  );

  const layers = () => [...layerSelect.options].map((o) => o.value);
  const cycle = (list, now, n) => list[(list.indexOf(now) + n + list.length) % list.length];
  const away = (f) => (e) => e.target.closest(".stage, [role=tab]") || f(e);
  app.keys = {
    ArrowLeft: away(() => step(-1)),
    ArrowRight: away(() => step(1)),
    l: () => setLayer(cycle(layers(), layer, 1)),
    L: () => setLayer(cycle(layers(), layer, -1)),
    t: () => {
      operator.value = cycle(OPERATOR_NAMES, operator.value, 1);
      picture.set({ operator: operator.value });
    },
    e: () => setExposure(picture.options.exposure + 0.5),
    E: () => setExposure(picture.options.exposure - 0.5),
    v: () => setMode(mode === "off" ? "split" : "off"),
    c: () => job.actions.includes("cancel") && act("cancel"),
    p: () => act(job.state === "paused" ? "resume" : "pause"),
    r: () => act("retry"),
  };
  tell();
  open("frames");
  load();
  const refresh = settled(() => {
    load();
    if (tab === "frames") loadFrames().catch(() => {});
    else if (tab === "units") loadUnits().catch(() => {});
    else if (tab === "log") log.load();
  }, 100);
  app.follow(`?job=${id}`, {
    job: (now) => {
      job = now;
      tell();
      if (!document.hidden) refresh();
    },
    gone: () => app.go("/"),
  });
  app.leaving.push(() => asking?.abort());
}
