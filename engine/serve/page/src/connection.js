// Whether the server answers. When it does not, a line at the top says so until it does.
import { address } from "./api.js";
import { announce, h, put, show } from "./dom.js";
import { t } from "./language.js";

const EVERY = 15000; // Milliseconds between two looks at a server that answers.
const AGAIN = 3000; // The same for one that does not.
const LONGEST = 8000; // Milliseconds until a request without an answer counts as lost.

const element = h("div", { class: "gone", role: "alert", hidden: true });
const backs = new Set();
let isGone = false;
let timer = 0;

/** Put the line into the page and begin to look. */
export function watchConnection() {
  const text = t("The server cannot be reached. What it computes goes on, and this page goes on by itself when the server is there again.");
  put(element, h("p", null, text));
  put(document.body, element);
  window.addEventListener("offline", suspect);
  window.addEventListener("online", suspect);
  document.addEventListener("visibilitychange", () => document.hidden || suspect());
  timer = setTimeout(look, EVERY);
}

/** Call `action` whenever the server answers again; return a function that ends this. */
export function onBack(action) {
  backs.add(action);
  return () => backs.delete(action);
}

/** Something failed as if the server was gone: look now. */
export function suspect() {
  clearTimeout(timer);
  timer = setTimeout(look, 0);
}

async function look() {
  clearTimeout(timer);
  const answers = await fetch(address("session"), { credentials: "same-origin", cache: "no-store", signal: AbortSignal.timeout(LONGEST) })
    .then(() => true)
    .catch(() => false);
  const wasGone = isGone;
  isGone = !answers;
  show(element, isGone);
  if (wasGone && answers) {
    announce(t("The server is there again."));
    for (const action of backs) action();
  }
  clearTimeout(timer);
  timer = setTimeout(look, isGone ? AGAIN : EVERY);
}
