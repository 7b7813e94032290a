// One's own account, and all users for administrators.

import { bytes, h } from "../dom.js";
import { call, get, post } from "./api.js";
import { ask, attempt, badge, coreHours, confirmed, field, toast, when } from "./ui.js";

export async function accountPage(main, app) {
  const me = await get("/me");
  const limit = (v, f = String) => (v === null ? "no limit" : f(v));
  const old = h("input", { type: "password", id: "old", autocomplete: "current-password", required: true });
  const fresh = h("input", { type: "password", id: "new", autocomplete: "new-password", required: true, minlength: "10" });
  const name = h("input", { id: "token-name", required: true, maxlength: "64", placeholder: "laptop" });
  const days = h("input", { id: "token-days", type: "number", min: "1", max: "3650", placeholder: "no end" });
  const list = h("tbody");
  const told = h("div", { class: "told", hidden: true });
  async function tokens() {
    const rows = await get("/tokens");
    list.replaceChildren(...rows.map((t) => h("tr", {}, h("td", {}, t.name), h("td", {}, when(t.created_at)), h("td", {}, t.expires_at ? when(t.expires_at) : "never"), h("td", {}, t.used_at ? when(t.used_at) : "never"),
      h("td", {}, h("button", { type: "button", class: "bad", onclick: async () => {
        if (!(await confirmed(`Revoke “${t.name}”?`, "Programs that use it are shut out at once.", "Revoke"))) return;
        await attempt(() => call("DELETE", `/tokens/${t.id}`), "Revoked");
        tokens();
      } }, "Revoke")))));
    if (!rows.length) list.replaceChildren(h("tr", {}, h("td", { colspan: "5", class: "soft" }, "There are no tokens.")));
  }
  main.append(h("div", { class: "columns" },
    h("section", { class: "card" }, h("h1", {}, me.name), h("dl", {},
      h("dt", {}, "Role"), h("dd", {}, me.role), h("dt", {}, "Jobs at a time"), h("dd", {}, limit(me.max_jobs)), h("dt", {}, "Room for packages"), h("dd", {}, limit(me.max_bytes, bytes)),
      h("dt", {}, "Work"), h("dd", {}, limit(me.max_core_secs, coreHours)), h("dt", {}, "Share"), h("dd", {}, me.share), h("dt", {}, "Since"), h("dd", {}, when(me.created_at)))),
    h("form", { class: "card", onsubmit: async (e) => {
      e.preventDefault();
      const done = await attempt(() => post("/me/password", { old: old.value, new: fresh.value }), "The password is changed. Sign in again.");
      old.value = fresh.value = "";
      if (done !== undefined) window.dispatchEvent(new Event("signed-out"));
    } }, h("h2", {}, "Password"), h("input", { type: "text", autocomplete: "username", value: me.name, hidden: true, readonly: true, "aria-hidden": "true" }), field("The old one", old), field("The new one", fresh, "At least 10 characters"), h("button", { class: "main" }, "Change")),
    h("section", { class: "card wide" }, h("h2", {}, "API tokens"), h("p", { class: "soft" }, "For scripts and `etendue farm` on other machines: Authorization: Bearer …"),
      h("form", { class: "row", onsubmit: async (e) => {
        e.preventDefault();
        const made = await attempt(() => post("/tokens", { name: name.value, days: days.value ? Number(days.value) : null }));
        if (!made) return;
        told.hidden = false;
        told.replaceChildren(h("p", {}, "This is the token. It is shown once:"), h("code", { id: "token" }, made.token));
        name.value = "";
        tokens();
      } }, field("Name", name), field("Days", days), h("button", { class: "main" }, "Make a token")), told,
      h("div", { class: "table-box" }, h("table", {}, h("thead", {}, h("tr", {}, ["Name", "Made", "Ends", "Last used", ""].map((t) => h("th", { scope: "col" }, t)))), list)))));
  await tokens();
}

export async function usersPage(main, app) {
  const body = h("tbody");
  const role = (value) => h("select", { value, "aria-label": "Role" }, ["viewer", "artist", "admin"].map((r) => h("option", { value: r, selected: r === value }, r)));
  const change = async (user, given, said) => {
    await attempt(() => call("PATCH", `/users/${encodeURIComponent(user.name)}`, { body: given }), said);
    load();
  };
  async function edit(user) {
    const jobs = h("input", { type: "number", min: "0", value: user.max_jobs ?? "", placeholder: "no limit" });
    const room = h("input", { type: "number", min: "0", step: "any", value: user.max_bytes === null ? "" : user.max_bytes / 1e9, placeholder: "no limit" });
    const work = h("input", { type: "number", min: "0", step: "any", value: user.max_core_secs === null ? "" : user.max_core_secs / 3600, placeholder: "no limit" });
    const share = h("input", { type: "number", min: "0.01", step: "any", value: user.share });
    const password = h("input", { type: "password", autocomplete: "new-password", placeholder: "as it is", minlength: "10" });
    const fields = h("div", { class: "fields" }, field("Jobs at a time", jobs), field("Room for packages in GB", room), field("Core hours", work), field("Share", share), user.name === app.session.name ? null : field("New password", password));
    if ((await ask(`Limits of ${user.name}`, "", [["", "Leave"], ["yes", "Save", "main"]], fields)) !== "yes") return;
    const number = (input, factor) => (input.value === "" ? null : Number(input.value) * factor);
    await change(user, { max_jobs: number(jobs, 1), max_bytes: room.value === "" ? null : Math.round(Number(room.value) * 1e9), max_core_secs: number(work, 3600), share: Number(share.value), password: password.value || null }, "Saved");
  }
  async function load() {
    const users = await get("/users");
    const limit = (v, f = String) => (v === null ? "–" : f(v));
    body.replaceChildren(...users.map((u) => {
      const select = role(u.role);
      select.addEventListener("change", () => change(u, { role: select.value }, `${u.name} is ${select.value} now`));
      return h("tr", {}, h("td", {}, h("strong", {}, u.name)), h("td", {}, select), h("td", {}, badge(u.is_active ? "alive" : "dead")), h("td", {}, limit(u.max_jobs)), h("td", {}, limit(u.max_bytes, bytes)), h("td", {}, limit(u.max_core_secs, coreHours)), h("td", {}, u.share), h("td", {}, when(u.created_at)),
        h("td", {}, h("div", { class: "row" }, h("button", { type: "button", onclick: () => edit(u) }, "Limits"), h("button", { type: "button", class: u.is_active ? "bad" : "", onclick: () => change(u, { is_active: !u.is_active }, u.is_active ? `${u.name} is shut out` : `${u.name} may sign in`) }, u.is_active ? "Shut out" : "Let in"))));
    }));
  }
  const name = h("input", { id: "user-name", required: true, maxlength: "64", autocomplete: "off" });
  const password = h("input", { id: "user-password", type: "password", required: true, minlength: "10", autocomplete: "new-password" });
  const kind = role("artist");
  main.append(h("div", { class: "bar" }, h("h1", {}, "Users")),
    h("form", { class: "card row", onsubmit: async (e) => {
      e.preventDefault();
      const made = await attempt(() => post("/users", { name: name.value, password: password.value, role: kind.value }));
      if (!made) return;
      toast(`${made.name} may sign in now.`);
      name.value = password.value = "";
      load();
    } }, field("Name", name), field("Password", password), field("Role", kind), h("button", { class: "main" }, "Add a user")),
    h("div", { class: "table-box" }, h("table", { id: "users" }, h("caption", { class: "visually-hidden" }, "Users"), h("thead", {}, h("tr", {}, ["Name", "Role", "State", "Jobs", "Room", "Work", "Share", "Since", ""].map((t) => h("th", { scope: "col" }, t)))), body)));
  await load();
}
