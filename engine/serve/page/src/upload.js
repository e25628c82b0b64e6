// Uploads by the tus protocol: several files at a time, with retries. The address of an unfinished upload is kept in the
// browser, so the same file chosen again after a reload goes on where it stopped. A file is known by its content: phones
// call every photo image.jpg and give it the time at which it was chosen.
import { Upload } from "tus-js-client";
import { BASE, headers, problemText } from "./api.js";
import { t } from "./language.js";

const AT_A_TIME = 3;
const CHUNK = 8 * 1024 * 1024; // Most photos fit in one; a video that is interrupted loses at most this much.
const RETRY_AFTER = [0, 1000, 3000, 5000, 10000, 20000, ...Array(60).fill(30000)]; // half an hour without a server
const WHOLE = 64 * 1024 * 1024; // Files up to this size are hashed whole, larger ones in samples.
const SAMPLE = 256 * 1024;
const N_SAMPLES = 64;
const FINAL = new Set([400, 401, 403, 404, 409, 410, 413, 415, 422, 507]); // The same request would fail again.

/**
 * Return a queue of uploads for a project. `changed(files)` is called with all files whenever something changes; a file
 * is {name, bytes, sent, state, reason}, with the state "waiting", "sending", "done" or "refused".
 */
export function createUploads(project, limits, changed) {
  const files = [];

  function add(chosen) {
    for (const file of chosen) {
      const entry = { name: file.name, bytes: file.size, sent: 0, state: "waiting", reason: "", file };
      const reason = refusal(file, limits);
      if (reason) Object.assign(entry, { state: "refused", reason });
      files.push(entry);
    }
    next();
  }

  function next() {
    const sending = files.filter((entry) => entry.state === "sending").length;
    for (const entry of files.filter((each) => each.state === "waiting").slice(0, AT_A_TIME - sending)) start(entry);
    changed(files);
  }

  async function start(entry) {
    entry.state = "sending";
    let known;
    try {
      known = await contentOf(entry.file);
    } catch {
      // The file was moved or changed since it was chosen.
      if (entry.state === "sending") finish(entry, "refused", t("The file cannot be read any more. Choose it again."));
      return;
    }
    if (entry.state !== "sending") return;
    const upload = new Upload(entry.file, {
      endpoint: `${BASE}/uploads/`,
      metadata: { project, filename: entry.name, filetype: entry.file.type, ...(known.sha256 ? { sha256: known.sha256 } : {}) },
      chunkSize: CHUNK,
      retryDelays: RETRY_AFTER,
      removeFingerprintOnSuccess: true,
      // The same photo may belong to two projects.
      fingerprint: async () => ["heritage", project, known.key].join("|"),
      onBeforeRequest: (request) => setHeaders(request),
      onShouldRetry: (error) => mayRetry(error.originalResponse),
      onProgress: (sent) => {
        entry.sent = sent;
        changed(files);
      },
      onSuccess: () => finish(entry, "done"),
      onError: (error) => finish(entry, "refused", reasonOf(error)),
    });
    entry.upload = upload;
    // Two equal files in one list are two uploads, so that neither ends the other.
    const inUse = new Set(files.map((other) => other.upload?.url).filter(Boolean));
    const earlier = (await upload.findPreviousUploads().catch(() => [])).filter((each) => !inUse.has(each.uploadUrl));
    if (entry.state !== "sending") return;
    if (earlier.length > 0) upload.resumeFromPreviousUpload(earlier[0]);
    upload.start();
  }

  function finish(entry, state, reason = "") {
    Object.assign(entry, { state, reason, sent: entry.bytes, file: null, upload: null });
    next();
  }

  /** Take a refused file off the list. */
  function forget(entry) {
    files.splice(files.indexOf(entry), 1);
    changed(files);
  }

  /** Stop everything; unfinished uploads can be resumed. */
  function stop() {
    for (const entry of files) {
      entry.upload?.abort();
      if (entry.state === "sending" || entry.state === "waiting") entry.state = "stopped";
    }
  }

  return { add, forget, stop, busy: () => files.some((entry) => entry.state === "waiting" || entry.state === "sending") };
}

/** Return {key, sha256}: what a file is known by, and the hash of all its bytes, which is empty for a large file. */
async function contentOf(file) {
  const facts = [file.name, file.size, file.lastModified].join("|");
  if (!crypto.subtle) return { key: facts, sha256: "" }; // Only pages over TLS and of this computer have it.
  if (file.size <= WHOLE) {
    const sha256 = await hash(await file.arrayBuffer());
    return { key: sha256, sha256 };
  }
  const step = (file.size - SAMPLE) / (N_SAMPLES - 1);
  const samples = Array.from({ length: N_SAMPLES }, (_, index) => file.slice(Math.floor(index * step), Math.floor(index * step) + SAMPLE));
  return { key: `${facts}|${await hash(await new Blob(samples).arrayBuffer())}`, sha256: "" };
}

async function hash(buffer) {
  const bytes = new Uint8Array(await crypto.subtle.digest("SHA-256", buffer));
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
}

/** Return whether the same request, or the rest of the file, may succeed later. */
function mayRetry(response) {
  if (!response) return true;
  // The server has other bytes than we thought; a refused file has no offset.
  if (response.getStatus() === 409 && response.getHeader("Upload-Offset") !== undefined) return true;
  return !FINAL.has(response.getStatus());
}

function setHeaders(request) {
  for (const [name, value] of Object.entries(headers())) request.setHeader(name, value);
}

/** Return why a file cannot be uploaded, as a sentence, or "". The server checks again. */
function refusal(file, limits) {
  const ending = `.${file.name.split(".").pop().toLowerCase()}`;
  const isPhoto = limits.photo_types.includes(ending);
  if (!isPhoto && !limits.video_types.includes(ending)) {
    return t("This kind of file cannot be used. Use {}.", [...limits.photo_types, ...limits.video_types].join(", "));
  }
  if (file.size === 0) return t("The file is empty.");
  if (isPhoto && file.size > limits.photo_bytes) {
    return t("The photo is larger than {} MB.", Math.floor(limits.photo_bytes / 1e6));
  }
  return "";
}

function reasonOf(error) {
  const response = error.originalResponse;
  if (!response) return t("The connection was lost. Choose the file again to go on.");
  let body = null;
  try {
    body = JSON.parse(response.getBody());
  } catch {
    // Not every answer is JSON.
  }
  return problemText(response.getStatus(), body);
}
