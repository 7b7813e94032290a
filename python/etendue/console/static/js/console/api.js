// Calls of the REST API. Refusals become errors with the server's sentence.

export const API = "/api/v1";
let csrf = null;

export class Refused extends Error {
  constructor(status, code, message) {
    super(message);
    this.status = status;
    this.code = code;
  }
}

export function setSession(session) {
  csrf = session?.csrf ?? null;
}

async function refusal(response) {
  let body = null;
  try {
    body = await response.json();
  } catch {
    // Not from us: a proxy, perhaps.
  }
  return new Refused(response.status, body?.error?.code ?? "failed", body?.error?.message ?? `The server answers ${response.status}.`);
}

/** Calls the API and returns its JSON (null for an empty answer). Query values that are null or empty are left out. */
export async function call(method, path, { query = {}, body, signal } = {}) {
  const response = await request(method, path, { query, body, signal });
  return response.status === 204 ? null : response.json();
}

export async function request(method, path, { query = {}, body, signal, headers = {} } = {}) {
  const parameters = new URLSearchParams();
  for (const [key, value] of Object.entries(query)) {
    for (const one of Array.isArray(value) ? value : [value]) if (one !== null && one !== undefined && one !== "") parameters.append(key, one);
  }
  const all = { ...headers };
  if (method !== "GET" && csrf) all["X-CSRF-Token"] = csrf;
  if (body !== undefined) all["Content-Type"] = "application/json";
  let response;
  try {
    response = await fetch(`${API}${path}${parameters.size ? `?${parameters}` : ""}`, {
      method,
      headers: all,
      body: body === undefined ? undefined : JSON.stringify(body),
      signal,
      credentials: "same-origin",
    });
  } catch (e) {
    if (e.name === "AbortError") throw e;
    throw new Refused(0, "offline", "The console cannot be reached.");
  }
  if (response.status === 401 && path !== "/session") window.dispatchEvent(new Event("signed-out"));
  if (!response.ok && response.status !== 304) throw await refusal(response);
  return response;
}

export const get = (path, query, signal) => call("GET", path, { query, signal });
export const post = (path, body) => call("POST", path, { body });

/** Uploads a file with progress (0 to 1). */
export function upload(file, scene, progress) {
  return new Promise((resolve, reject) => {
    const query = new URLSearchParams({ filename: file.name });
    if (scene) query.set("scene", scene);
    const xhr = new XMLHttpRequest();
    xhr.open("POST", `${API}/packages?${query}`);
    xhr.setRequestHeader("X-CSRF-Token", csrf ?? "");
    xhr.setRequestHeader("Content-Type", "application/octet-stream");
    xhr.upload.addEventListener("progress", (e) => e.lengthComputable && progress(e.loaded / e.total));
    xhr.addEventListener("load", () => {
      let body = null;
      try {
        body = JSON.parse(xhr.responseText);
      } catch {
        // Told below.
      }
      if (xhr.status < 300 && body) resolve(body);
      else reject(new Refused(xhr.status, body?.error?.code ?? "failed", body?.error?.message ?? `The server answers ${xhr.status}.`));
    });
    // A server that refuses early closes the connection while the browser still sends.
    xhr.addEventListener("error", () => reject(new Refused(0, "offline", "The upload was cut off: the file may be larger than the farm takes.")));
    xhr.send(file);
  });
}
