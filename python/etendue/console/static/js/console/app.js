// The console's frame: who is signed in, which page is shown, keys that work everywhere.

import { $, h, themeButton } from "../dom.js";
import { call, get, post, setSession } from "./api.js";
import { accountPage, usersPage } from "./account.js";
import { costPage, logPage, nodesPage } from "./farm.js";
import { jobPage } from "./job.js";
import { jobsPage } from "./jobs.js";
import { submitPage } from "./submit.js";
import { ask, attempt, sentence, toast } from "./ui.js";

const PAGES = [
  [/^\/$/, "Jobs", jobsPage],
  [/^\/submit$/, "Submit", submitPage],
  [/^\/jobs\/(\d+)$/, "Job", jobPage],
  [/^\/nodes$/, "Nodes", nodesPage],
  [/^\/cost$/, "Cost", costPage],
  [/^\/log$/, "Log", logPage],
  [/^\/account$/, "Account", accountPage],
  [/^\/users$/, "Users", usersPage],
];
const NAV = [
  ["/", "Jobs"],
  ["/submit", "Submit"],
  ["/nodes", "Nodes"],
  ["/cost", "Cost"],
  ["/log", "Log"],
];

/** What pages share: the session, going elsewhere, and things to do when the page is left. */
const app = {
  session: null,
  status: null,
  go(path) {
    if (path !== location.pathname + location.search) history.pushState(null, "", path);
    show();
  },
  replace(path) {
    history.replaceState(null, "", path);
  },
  /** Follows the server's events until the page is left. */
  follow(query, handlers) {
    const source = new EventSource(`/api/v1/events${query}`);
    for (const [name, handler] of Object.entries(handlers)) source.addEventListener(name, (e) => handler(JSON.parse(e.data)));
    source.addEventListener("open", () => (document.body.dataset.live = "true"));
    source.addEventListener("error", () => (document.body.dataset.live = "false"));
    this.leaving.push(() => source.close());
  },
  every(ms, f) {
    const timer = setInterval(() => !document.hidden && f(), ms);
    this.leaving.push(() => clearInterval(timer));
  },
  /** Keys of the page: a map of key to action. They do not work while one types. */
  keys: {},
  leaving: [],
};

function leave() {
  for (const f of app.leaving.splice(0)) f();
  app.keys = {};
}

async function show() {
  leave();
  const main = $("#main");
  if (!app.session) {
    signInPage(main);
    return;
  }
  const path = location.pathname;
  const [pattern, title, page] = PAGES.find(([p]) => p.test(path)) ?? [null, "Not found", notFound];
  document.title = `${title} – Etendue farm`;
  for (const link of $("#nav").children) {
    const own = link.getAttribute("href");
    const isHere = own === path || (own === "/" && path.startsWith("/jobs/"));
    if (isHere) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  main.replaceChildren();
  try {
    await page(main, app, ...(pattern ? pattern.exec(path).slice(1) : []));
  } catch (e) {
    if (e.name === "AbortError") return;
    main.replaceChildren(h("section", { class: "card narrow" }, h("h1", {}, "This does not work"), h("p", { role: "alert" }, e.message), h("a", { href: "/" }, "To the jobs")));
  }
}

function notFound(main) {
  main.append(h("section", { class: "card narrow" }, h("h1", {}, "There is no such page"), h("a", { href: "/" }, "To the jobs")));
}

function signInPage(main) {
  document.title = "Sign in – Etendue farm";
  $("#top").hidden = true;
  const fault = h("p", { role: "alert", class: "fault", hidden: true });
  const name = h("input", { id: "name", name: "username", autocomplete: "username", required: true, maxlength: "64" });
  const password = h("input", { id: "password", name: "password", type: "password", autocomplete: "current-password", required: true });
  const button = h("button", { class: "main" }, "Sign in");
  const form = h("form", { class: "card narrow sign-in", onsubmit: async (e) => {
    e.preventDefault();
    button.disabled = true;
    fault.hidden = true;
    try {
      enter(await post("/session", { name: name.value, password: password.value }));
      if (location.pathname === "/sign-in") history.replaceState(null, "", "/");
      await show();
    } catch (error) {
      fault.textContent = sentence(error.message);
      fault.hidden = false;
      password.value = "";
      password.focus();
    } finally {
      button.disabled = false;
    }
  } },
    h("h1", { class: "brand" }, h("img", { src: "/static/icon.svg", alt: "", width: "32", height: "32" }), "Etendue farm"),
    h("label", { class: "field" }, h("span", {}, "Name"), name),
    h("label", { class: "field" }, h("span", {}, "Password"), password),
    fault, button);
  main.replaceChildren(form);
  name.focus();
}

function enter(session) {
  app.session = session;
  setSession(session);
  if (!session) return;
  $("#top").hidden = false;
  const links = session.role === "admin" ? [...NAV, ["/users", "Users"]] : session.role === "viewer" ? NAV.filter(([p]) => p !== "/submit") : NAV;
  $("#nav").replaceChildren(...links.map(([path, text]) => h("a", { href: path }, text)));
  $("#who").textContent = session.name;
  $("#who").title = `${session.name} (${session.role}): account`;
  tellStatus();
}

async function tellStatus() {
  if (!app.session) return;
  try {
    app.status = await get("/status");
    const { is_up, nodes_alive, cores, units_running, units_queued } = app.status;
    $("#farm").textContent = is_up ? `${nodes_alive} node${nodes_alive === 1 ? "" : "s"}, ${cores} cores, ${units_running} running, ${units_queued.toLocaleString("en")} waiting` : "no scheduler at work";
    $("#farm").classList.toggle("bad", !is_up);
  } catch {
    $("#farm").textContent = "not reachable";
  }
}

const HELP = [
  ["g then j / s / n / c / l", "jobs, submit, nodes, cost, log"],
  ["/", "search"],
  ["j k, arrows", "next, previous row"],
  ["Enter", "open"],
  ["x", "choose the row"],
  ["c, p, r", "cancel, pause or resume, retry"],
  ["on a job: ← →", "previous, next frame"],
  ["on a job: l, t", "next layer, next tone mapping"],
  ["on a job: e, Shift + e", "brighter, darker"],
  ["on a job: v", "compare with the version before"],
  ["in the picture: + − 0 1", "zoom, fit, one to one"],
  ["?", "this list"],
];
const help = () =>
  ask("Keys", "", [["", "Close", "main"]], h("dl", { class: "keys" }, HELP.flatMap(([k, what]) => [h("dt", {}, h("kbd", {}, k)), h("dd", {}, what)])));

let isGoing = false;
document.addEventListener("keydown", (e) => {
  if (e.ctrlKey || e.metaKey || e.altKey || document.querySelector("dialog[open]") || !app.session) return;
  if (e.target.closest("input:not([type=checkbox]), select, textarea") && e.key !== "Escape") return;
  if (e.key === "Escape") {
    document.activeElement?.blur();
    return;
  }
  if (isGoing) {
    isGoing = false;
    const path = { j: "/", s: "/submit", n: "/nodes", c: "/cost", l: "/log" }[e.key];
    if (path) app.go(path);
    return;
  }
  if (e.key === "g") {
    isGoing = true;
    setTimeout(() => (isGoing = false), 1500);
  } else if (e.key === "?") help();
  else if (app.keys[e.key]) app.keys[e.key](e);
  else return;
  if (e.key !== "Enter" && !(e.key === " ")) e.preventDefault();
});

document.addEventListener("click", (e) => {
  const link = e.target.closest("a[href^='/']");
  if (!link || link.hasAttribute("download") || link.target || e.ctrlKey || e.metaKey || e.shiftKey || e.button || link.pathname.startsWith("/api/")) return;
  e.preventDefault();
  app.go(link.getAttribute("href"));
  $("#main").focus({ preventScroll: true });
  window.scrollTo(0, 0);
});
window.addEventListener("popstate", show);
window.addEventListener("signed-out", () => {
  if (!app.session) return;
  enter(null);
  app.session = null;
  toast("Your session has ended. Sign in again.");
  show();
});
$("#sign-out").addEventListener("click", async () => {
  await attempt(() => call("DELETE", "/session"));
  app.session = null;
  setSession(null);
  history.replaceState(null, "", "/sign-in");
  show();
});
$("#help").addEventListener("click", help);
$("#theme-slot").append(themeButton());
setInterval(() => !document.hidden && tellStatus(), 4000);

try {
  enter(await get("/session"));
} catch (e) {
  toast(e.message, { isError: true });
}
show();
