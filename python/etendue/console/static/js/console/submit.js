// Uploading a scene and submitting a job.

import { bytes, h } from "../dom.js";
import { get, post, upload } from "./api.js";
import { attempt, check, field, lossReport, sentence, toast } from "./ui.js";

const SCENES = /\.(xml|pov|pbrt|gltf|glb|obj|ply|stl)$/i;
const FORMATS = ["exr", "png", "jpg", "hdr", "pfm", "film"];
const AOVS = ["albedo", "normal", "depth", "position", "uv", "object", "material", "variance", "samples"];
const COMMANDS = [["render", "Picture or animation"], ["study", "Study"], ["bake", "Baked light"], ["photons", "Photon map"]];
const MAX_RUNS = 1000;
// Those that have a field of their own.
const OWN = ["width", "height", "spp", "integrator", "max_depth", "camera", "seed"];
// Those of them that say nothing to a bake.
const OF_VIEWS = ["width", "height", "integrator", "camera"];
// Groups of the form, by what is made.
const SHOWN = { render: ["Picture", "Animation", "Stop earlier", "Files", "Layers beside the picture"], study: ["Picture", "Study", "Stop earlier", "Files", "Layers beside the picture"], bake: ["Picture", "Bake"], photons: ["Photons"] };

export async function submitPage(main, app) {
  const address = new URLSearchParams(location.search);
  const parameters = await get("/parameters");
  let chosen = null;

  // ------------------------------------------------------------------------------------------------------------ upload
  const input = h("input", { type: "file", id: "file", accept: ".zip,.xml,.pov,.pbrt,.gltf,.glb,.obj,.ply,.stl", class: "visually-hidden" });
  const meter = h("progress", { max: "1", hidden: true, "aria-label": "Upload" });
  const told = h("p", { role: "status", class: "soft" }, "A zip with the scene and its files, or a single scene file.");
  const fault = h("p", { role: "alert", class: "fault", hidden: true });
  const drop = h("label", { class: "drop", id: "drop" }, input, h("strong", {}, "Drop a scene here"), h("span", {}, "or choose a file"), told, meter);
  const report = h("section", { class: "card", id: "report", hidden: true, "aria-label": "The scene" });
  const earlier = h("select", { id: "earlier" }, h("option", { value: "" }, "…"));
  async function take(file) {
    if (!file) return;
    fault.hidden = true;
    meter.hidden = false;
    meter.value = 0;
    told.textContent = `${file.name}, ${bytes(file.size)} …`;
    try {
      const found = await upload(file, null, (share) => {
        meter.value = share;
        if (share === 1) told.textContent = `${file.name}: reading the scene …`;
      });
      told.textContent = `${file.name} is there.`;
      choose(found);
      listPackages();
    } catch (e) {
      told.textContent = "A zip with the scene and its files, or a single scene file.";
      fault.textContent = sentence(e.message);
      fault.hidden = false;
    } finally {
      meter.hidden = true;
      input.value = "";
    }
  }
  input.addEventListener("change", () => take(input.files[0]));
  for (const type of ["dragenter", "dragover"]) drop.addEventListener(type, (e) => {
    e.preventDefault();
    drop.classList.add("over");
  });
  for (const type of ["dragleave", "drop"]) drop.addEventListener(type, () => drop.classList.remove("over"));
  drop.addEventListener("drop", (e) => {
    e.preventDefault();
    const files = [...e.dataTransfer.files];
    if (files.length > 1) toast("One file at a time: pack a scene with its files into a zip.", { isError: true });
    else take(files[0]);
  });
  // A file that is dropped beside it must not replace the page.
  for (const type of ["dragover", "drop"]) {
    const stop = (e) => e.preventDefault();
    window.addEventListener(type, stop);
    app.leaving.push(() => window.removeEventListener(type, stop));
  }

  // -------------------------------------------------------------------------------------------------------------- order
  const number = (id, attributes = {}) => h("input", { type: "number", id, min: "1", ...attributes });
  const f = {
    name: h("input", { id: "job-name", maxlength: "256", placeholder: "the scene's name" }),
    scene: h("select", { id: "scene" }),
    width: number("width", { placeholder: "as the scene says" }),
    height: number("height", { placeholder: "as the scene says" }),
    spp: number("spp", { placeholder: "as the scene says" }),
    integrator: h("select", { id: "integrator" }),
    max_depth: number("max_depth", { min: "0", placeholder: "as the scene says" }),
    camera: h("select", { id: "camera" }),
    seed: number("seed", { min: "0", placeholder: "0" }),
    command: h("select", { id: "command" }, COMMANDS.map(([value, text]) => h("option", { value }, text))),
    axes: h("textarea", { id: "axes", rows: "3", placeholder: "integrator=path,bdpt,vcm" }),
    method: h("select", { id: "bake-method" }, ["path", "radiosity", "particles"].map((n) => h("option", {}, n))),
    display: h("select", { id: "bake-display" }, ["emissive", "unlit", "lightmap"].map((n) => h("option", {}, n))),
    resolution: number("bake-resolution", { min: "16", max: "16384", placeholder: "1024" }),
    density: number("bake-density", { min: "0", step: "any", placeholder: "what fits into one atlas" }),
    photons: number("photons", { placeholder: "1000000" }),
    frames: h("input", { id: "frames-field", placeholder: "a still; or 1-48, 1-100x5, 1,4,10-12", pattern: "[0-9,x \\-]*" }),
    clock0: h("input", { type: "number", step: "any", id: "clock0", value: "0" }),
    clock1: h("input", { type: "number", step: "any", id: "clock1", value: "1" }),
    every: number("every", { min: "2", placeholder: "all in order" }),
    noise: h("input", { type: "number", id: "noise", min: "0.0001", step: "any", placeholder: "never" }),
    time: number("time", { min: "1", step: "any", placeholder: "never" }),
    cost: h("input", { type: "number", id: "cost", min: "0", step: "any", placeholder: "never" }),
    priority: h("input", { type: "number", id: "priority", min: "-100", max: "100", value: "0" }),
    notify: h("input", { type: "url", id: "notify", placeholder: "https://…" }),
    defines: h("textarea", { id: "defines", rows: "3", placeholder: "KEY=VALUE, one to a line" }),
    more: h("textarea", { id: "more", rows: "4", placeholder: "setting=value, one to a line" }),
  };
  const vertices = check("Colors of vertices instead of textures", { id: "bake-vertices" });
  const gather = check("Final gathering", { id: "bake-gather" });
  const maps = check("Also the maps, as EXR", { id: "bake-exr" });
  const approval = check("Wait for my approval after those", { id: "approval" });
  const shared = check("Everyone may look at it", { id: "shared" });
  const formats = FORMATS.map((name) => check(name.toUpperCase(), { id: `format-${name}`, value: name, checked: ["exr", "png"].includes(name) }));
  const aovs = AOVS.map((name) => check(name, { id: `aov-${name}`, value: name }));
  const ticked = (list) => list.map((l) => l.firstChild).filter((i) => i.checked).map((i) => i.value);
  const send = h("button", { class: "main", id: "send" }, "Submit");
  const orderFault = h("p", { role: "alert", class: "fault", hidden: true });
  const groups = {};
  const group = (title, ...children) => (groups[title] = h("fieldset", {}, h("legend", {}, title), children));
  const show = () => {
    for (const title of new Set(Object.values(SHOWN).flat())) groups[title].hidden = !SHOWN[f.command.value].includes(title);
    for (const key of OF_VIEWS) f[key].closest("label").hidden = f.command.value === "bake";
  };
  f.command.addEventListener("change", show);
  const rest = parameters.filter((p) => !OWN.includes(p.name));
  const form = h("form", { class: "card order", id: "order", hidden: true, onsubmit: submit },
    group("Job", h("div", { class: "fields" }, field("What to make", f.command), field("Name", f.name), field("Scene file", f.scene), field("Priority", f.priority, "−100 to 100; above 50 for administrators"), shared)),
    group("Picture", h("div", { class: "fields" }, field("Width in pixels", f.width), field("Height in pixels", f.height), field("Samples per pixel or texel", f.spp), field("Integrator", f.integrator), field("Longest path", f.max_depth), field("Camera", f.camera), field("Seed", f.seed))),
    group("Animation", h("div", { class: "fields" }, field("Frames", f.frames), field("Clock of the first frame", f.clock0), field("Clock of the last frame", f.clock1), field("Every so many first", f.every), approval)),
    group("Study", field("Settings and their values", f.axes, "one setting to a line; a picture for each combination")),
    group("Bake", h("div", { class: "fields" }, field("Method", f.method), field("Shown as", f.display), field("Largest edge of an atlas", f.resolution), field("Texels for a unit of length", f.density), vertices, gather, maps)),
    group("Photons", h("div", { class: "fields" }, field("Number of photons", f.photons))),
    group("Stop earlier", h("div", { class: "fields" }, field("At a relative error of", f.noise, "0.02 is 2 %"), field("After seconds", f.time), field("At a cost of", f.cost))),
    group("Files", h("div", { class: "row ticks" }, formats)),
    group("Layers beside the picture", h("div", { class: "row ticks" }, aovs)),
    h("details", {}, h("summary", {}, "More"),
      field("Settings", f.more), h("details", {}, h("summary", {}, "What there is"), h("dl", { class: "settings" }, rest.flatMap((p) => [h("dt", {}, h("code", {}, p.name)), h("dd", {}, `${p.doc} ${p.default === "None" ? "" : `(${p.default})`}`)]))),
      field("Values for the scene's parameters", f.defines), field("Tell this address when it ends", f.notify)),
    orderFault, h("div", { class: "row end" }, send));

  function pairs(text) {
    const out = {};
    for (const line of text.split("\n").map((l) => l.trim()).filter(Boolean)) {
      const at = line.indexOf("=");
      if (at < 1) throw new Error(`“${line}” is not of the form KEY=VALUE.`);
      const value = line.slice(at + 1).trim();
      out[line.slice(0, at).trim()] = value === "true" ? true : value === "false" ? false : value !== "" && Number.isFinite(Number(value)) ? Number(value) : value;
    }
    return out;
  }
  /** All combinations of the values that lines `setting=a,b` give; the last line changes fastest. */
  function combinations(text) {
    const axes = text.split("\n").map((l) => l.trim()).filter(Boolean).map((line) => {
      const at = line.indexOf("=");
      if (at < 1) throw new Error(`“${line}” is not of the form SETTING=VALUE,VALUE.`);
      return line.slice(at + 1).split(",").map((v) => v.trim()).filter(Boolean).map((v) => pairs(`${line.slice(0, at)}=${v}`));
    });
    const count = axes.reduce((n, axis) => n * axis.length, 1);
    if (!axes.length || count < 1 || count > MAX_RUNS) throw new Error(`A study has 1 to ${MAX_RUNS} combinations of settings.`);
    return axes.reduce((runs, axis) => runs.flatMap((run) => axis.map((value) => ({ ...run, ...value }))), [{}]);
  }
  const numeric = (element) => (element.value === "" ? null : Number(element.value));
  async function submit(e) {
    e.preventDefault();
    orderFault.hidden = true;
    send.disabled = true;
    try {
      const settings = { ...pairs(f.more.value) };
      const command = f.command.value;
      const isPicture = command === "render" || command === "study";
      if (command === "photons" && numeric(f.photons) !== null) settings.photons = numeric(f.photons);
      for (const key of isPicture ? OWN : command === "bake" ? OWN.filter((k) => !OF_VIEWS.includes(k)) : ["seed", "max_depth"]) {
        const value = ["integrator", "camera"].includes(key) ? f[key].value || null : numeric(f[key]);
        if (value !== null) settings[key] = value;
      }
      const isAnimation = command === "render" && f.frames.value.trim() !== "";
      const spec = {
        package: chosen.id,
        scene: f.scene.value,
        name: f.name.value,
        command,
        settings,
        defines: pairs(f.defines.value),
        priority: numeric(f.priority) ?? 0,
        shared: shared.firstChild.checked,
        notify: f.notify.value || null,
      };
      if (isPicture) Object.assign(spec, { formats: ticked(formats), aovs: ticked(aovs), stop: { noise: numeric(f.noise), secs: numeric(f.time), cost: numeric(f.cost) } });
      if (command === "study") spec.runs = combinations(f.axes.value);
      if (command === "bake") {
        spec.bake = { method: f.method.value, display: f.display.value, texels_per_meter: numeric(f.density), per_vertex: vertices.firstChild.checked, final_gather: gather.firstChild.checked, exr: maps.firstChild.checked };
        if (numeric(f.resolution) !== null) spec.bake.resolution = numeric(f.resolution);
      }
      if (isAnimation) Object.assign(spec, { frames: f.frames.value.trim(), clocks: [numeric(f.clock0) ?? 0, numeric(f.clock1) ?? 1], every_first: numeric(f.every), approval: approval.firstChild.checked });
      const job = await post("/jobs", spec);
      toast(`“${job.name}” is submitted.`);
      app.go(`/jobs/${job.id}`);
    } catch (error) {
      orderFault.textContent = error.message;
      orderFault.hidden = false;
    } finally {
      send.disabled = false;
    }
  }

  function choose(found) {
    chosen = found;
    const { info } = found;
    report.hidden = form.hidden = false;
    const count = (n, one) => `${n.toLocaleString("en")} ${one}${n === 1 ? "" : "s"}`;
    report.replaceChildren(
      h("h2", {}, found.name),
      h("p", {}, `${info.format}: ${[count(info.shapes, "shape"), count(info.triangles, "triangle"), count(info.lights.length + info.emissive_shapes, "light"), count(info.textures, "texture")].join(", ")}; ${count(found.files.length, "file")}, ${bytes(found.bytes)}`),
      lossReport(info));
    const scenes = found.files.map((r) => r[0]).filter((p) => SCENES.test(p));
    f.scene.replaceChildren(...scenes.map((s) => h("option", {}, s)));
    f.scene.value = found.scene;
    const doc = parameters.find((p) => p.name === "integrator").doc;
    const names = doc.slice(doc.indexOf(":") + 1).replace(/\.\s*$/, "").split(",").map((t) => t.trim().split(" ")[0]).filter(Boolean);
    f.integrator.replaceChildren(h("option", { value: "" }, "as the scene says"), ...names.map((n) => h("option", {}, n)));
    f.camera.replaceChildren(h("option", { value: "" }, "the first"), ...info.cameras.map(([name], i) => h("option", { value: name || String(i) }, name || `camera ${i}`)));
    if (info.width) [f.width.placeholder, f.height.placeholder] = [String(info.width), String(info.height)];
    f.spp.placeholder = info.spp ? String(info.spp) : "as the scene says";
    earlier.value = [...earlier.options].some((o) => o.value === found.id) ? found.id : "";
  }
  /** The lines that give these combinations, where they are all of some values. */
  function axesOf(runs) {
    const names = [...new Set(runs.flatMap((run) => Object.keys(run)))];
    return names.map((name) => `${name}=${[...new Set(runs.map((run) => run[name]))].join(",")}`).join("\n");
  }
  let packages = [];
  async function listPackages() {
    packages = (await get("/packages", { limit: 200 })).items;
    earlier.replaceChildren(h("option", { value: "" }, packages.length ? "choose …" : "none yet"), ...packages.map((p) => h("option", { value: p.id }, `${p.name} (${new Date(p.created_at * 1000).toLocaleString()})`)));
    if (chosen) earlier.value = chosen.id;
  }
  earlier.addEventListener("change", () => {
    const found = packages.find((p) => p.id === earlier.value);
    if (found) choose(found);
  });

  show();
  main.append(h("div", { class: "bar" }, h("h1", {}, "Submit a job")), drop, fault, h("div", { class: "row" }, field("Or a scene that is there already", earlier)), report, form);
  await listPackages();
  const known = packages.find((p) => p.id === address.get("package"));
  if (known) choose(known);
  const like = address.get("like") ? await attempt(() => get(`/jobs/${Number(address.get("like"))}`)) : null;
  if (like) fillFrom(like.spec);

  /** Puts the order of an earlier job into the form. */
  function fillFrom(spec) {
    f.command.value = spec.command ?? "render";
    show();
    f.photons.value = spec.settings?.photons ?? "";
    f.axes.value = axesOf(spec.runs ?? []);
    const bake = spec.bake ?? {};
    [f.method.value, f.display.value] = [bake.method ?? "path", bake.display ?? "emissive"];
    [f.resolution.value, f.density.value] = [bake.resolution ?? "", bake.texels_per_meter ?? ""];
    [vertices, gather, maps].forEach((box, i) => (box.firstChild.checked = [bake.per_vertex, bake.final_gather, bake.exr][i] ?? false));
    f.name.value = spec.name ?? "";
    for (const key of OWN) if (spec.settings?.[key] !== undefined) f[key].value = spec.settings[key];
    f.more.value = Object.entries(spec.settings ?? {}).filter(([k]) => !OWN.includes(k)).map(([k, v]) => `${k}=${v}`).join("\n");
    f.defines.value = Object.entries(spec.defines ?? {}).map(([k, v]) => `${k}=${v}`).join("\n");
    f.frames.value = spec.frames ?? "";
    [f.clock0.value, f.clock1.value] = spec.clocks ?? [0, 1];
    f.every.value = spec.every_first ?? "";
    f.noise.value = spec.stop?.noise ?? "";
    f.priority.value = spec.priority ?? 0;
    for (const box of formats) box.firstChild.checked = (spec.formats ?? []).includes(box.firstChild.value);
    for (const box of aovs) box.firstChild.checked = (spec.aovs ?? []).includes(box.firstChild.value);
  }
}
