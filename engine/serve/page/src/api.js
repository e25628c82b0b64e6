// Requests to the server. Every problem becomes an `Error` whose message is a sentence for the person.
import { language, said, t } from "./language.js";

export const BASE = "/api/v1";

let csrf = "";
let signedOut = () => {};

/** Call `action` when the server no longer knows the session. */
export function onSignedOut(action) {
  signedOut = action;
}

/** Headers that every request that changes something must carry. */
export function headers() {
  return { "X-CSRF-Token": csrf };
}

/** Return the address of a file of the API; each part is escaped. */
export function address(...parts) {
  // Photo names may contain a folder, whose slash stays one.
  return [BASE, ...parts.map((part) => String(part).split("/").map(encodeURIComponent).join("/"))].join("/");
}

export async function request(method, path, body) {
  const options = { method, headers: {}, credentials: "same-origin" };
  if (method !== "GET") Object.assign(options.headers, headers());
  if (body !== undefined) {
    options.headers["Content-Type"] = "application/json";
    options.body = JSON.stringify(body);
  }
  let response;
  try {
    response = await fetch(path, options);
  } catch {
    throw new Error(t("The server cannot be reached. Check the connection and try again."));
  }
  if (!response.ok) {
    const isSignIn = path === `${BASE}/session`;
    if (response.status === 401 && !isSignIn) signedOut();
    throw new Error(await problem(response));
  }
  return response.status === 204 ? null : response.json().catch(() => null);
}

async function problem(response) {
  const body = await response.json().catch(() => null);
  return problemText(response.status, body);
}

/** Return a sentence for a refused request. `body` is the parsed answer, if there is one. */
export function problemText(status, body) {
  if (typeof body?.detail === "string" && body.detail) return said(body.detail);
  if (status === 401) return t("You are signed out. Sign in again.");
  if (status === 403) return t("The server refused this. Load the page again.");
  if (status === 404) return t("This does not exist any more. Load the page again.");
  if (status === 413) return t("The file is too large for this server.");
  if (status === 507) return t("The disk of the server is full.");
  return t("The server could not do this (error {}). Try again later.", status);
}

/** Return this browser's name for itself, by which the server counts the streams of all its tabs. */
function browserName() {
  const key = "heritage browser";
  try {
    if (!localStorage.getItem(key)) localStorage.setItem(key, Math.random().toString(36).slice(2));
    return localStorage.getItem(key);
  } catch {
    return ""; // Storage is switched off: the tabs cannot know of each other.
  }
}

function remember(session) {
  csrf = session?.csrf ?? "";
  return session;
}

export const getSession = async () => remember(await request("GET", address("session")));
export const signIn = async (token) => remember(await request("POST", address("session"), { token }));
export const signOut = () => request("DELETE", address("session"));

export const listProjects = () => request("GET", address("projects"));
export const createProject = (title) => request("POST", address("projects"), { title });
export const getProject = (id) => request("GET", address("projects", id));
export const renameProject = (id, title) => request("PATCH", address("projects", id), { title });
export const deleteProject = (id) => request("DELETE", address("projects", id));

export const photoUrl = (id, name, side) => `${address("projects", id, "photos", name)}?side=${side}`;
/** Move a photo or video to the trash; return {id, name, bytes}, whose id brings it back. */
export const deletePhoto = (id, name) => request("DELETE", address("projects", id, "photos", name));
export const restorePhoto = (id, item) => request("POST", address("projects", id, "trash", item, "restore"));
export const listDeletedProjects = () => request("GET", address("trash"));
export const restoreProject = (item) => request("POST", address("trash", item, "restore"));
export const emptyTrash = () => request("DELETE", address("trash"));

export const setLearning = (id, learns) => request("PUT", address("projects", id, "learning"), { learns });
export const startJob = (id, job) => request("POST", address("projects", id, "jobs"), job);
export const stopJob = (id, job) => request("DELETE", address("projects", id, "jobs", job));
export const continueJob = (id, job) => request("POST", address("projects", id, "jobs", job, "continue"));

export const eventsUrl = (id) => `${address("projects", id, "events")}?browser=${browserName()}`;
/** Ask a scene that is being trained for things; return {step, found: [{text, photo, picture}], refused: {text: reason}}. */
export const askScene = (id, prompt) => request("POST", address("projects", id, "ask"), { prompt });
export const previewUrl = (id, stamp) => `${address("projects", id, "preview.png")}?t=${stamp}`;
export const getCameras = (id) => request("GET", address("projects", id, "cameras"));
export const viewUrl = (id, photo, side) => `${address("projects", id, "views", photo)}?side=${side}`;
/** Return where the photo of a camera shows a point, {x, y}, or null where it does not. */
export const getPixel = (id, name, [x, y, z]) =>
  request("GET", `${address("projects", id, "views", name, "pixel")}?x=${x}&y=${y}&z=${z}`);
export const sceneUrl = (id) => address("projects", id, "scene.ply");
export const reportUrl = (id) => `${address("projects", id, "report")}?language=${language()}`;
export const sceneExportUrl = (id, format) => `${address("projects", id, "export")}?format=${format}`;

export const objectUrl = (id, object) => `${address("projects", id, "objects", `${object}.ply`)}?frame=scene`;
export const exportUrl = (id, object, format) => `${address("projects", id, "objects", object, "export")}?format=${format}`;
export const changeObject = (id, object, values) => request("PATCH", address("projects", id, "objects", object), values);
export const deleteObject = (id, object) => request("DELETE", address("projects", id, "objects", object));
