// Uploads by the tus protocol: several files at a time, with retries. The address of an unfinished upload is kept in the
// browser, so the same file chosen again after a reload goes on where it stopped.
import { Upload } from "tus-js-client";
import { BASE, headers, problemText } from "./api.js";

const AT_A_TIME = 3;
const CHUNK = 8 * 1024 * 1024; // Most photos fit in one; a video that is interrupted loses at most this much.
const RETRY_AFTER = [0, 1000, 3000, 5000, 10000, 20000];
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
    const upload = new Upload(entry.file, {
      endpoint: `${BASE}/uploads/`,
      metadata: { project, filename: entry.name },
      chunkSize: CHUNK,
      retryDelays: RETRY_AFTER,
      removeFingerprintOnSuccess: true,
      // The same photo may belong to two projects.
      fingerprint: async ({ name, size, lastModified }) => ["heritage", project, name, size, lastModified].join("|"),
      onBeforeRequest: (request) => setHeaders(request),
      onShouldRetry: (error) => !FINAL.has(error.originalResponse?.getStatus()),
      onProgress: (sent) => {
        entry.sent = sent;
        changed(files);
      },
      onSuccess: () => finish(entry, "done"),
      onError: (error) => finish(entry, "refused", reasonOf(error)),
    });
    entry.upload = upload;
    const earlier = await upload.findPreviousUploads().catch(() => []);
    if (earlier.length > 0) upload.resumeFromPreviousUpload(earlier[0]);
    if (entry.state === "sending") upload.start();
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

function setHeaders(request) {
  for (const [name, value] of Object.entries(headers())) request.setHeader(name, value);
}

/** Return why a file cannot be uploaded, as a sentence, or "". The server checks again. */
function refusal(file, limits) {
  const ending = `.${file.name.split(".").pop().toLowerCase()}`;
  const isPhoto = limits.photo_types.includes(ending);
  if (!isPhoto && !limits.video_types.includes(ending)) {
    return `This kind of file cannot be used. Use ${[...limits.photo_types, ...limits.video_types].join(", ")}.`;
  }
  if (file.size === 0) return "The file is empty.";
  if (isPhoto && file.size > limits.photo_bytes) {
    return `The photo is larger than ${Math.floor(limits.photo_bytes / 1e6)} MB.`;
  }
  return "";
}

function reasonOf(error) {
  const response = error.originalResponse;
  if (!response) return "The connection was lost. Choose the file again to go on.";
  let body = null;
  try {
    body = JSON.parse(response.getBody());
  } catch {
    // Not every answer is JSON.
  }
  return problemText(response.getStatus(), body);
}
