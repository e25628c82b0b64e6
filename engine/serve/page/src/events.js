// Server-sent events of a project, with reconnection.
import { suspect } from "./connection.js";

const FIRST_WAIT = 2000;
const LONGEST_WAIT = 30000;
const ASK_EVERY = 5000;

/**
 * A browser has few connections to a server, so only its newest tabs keep one for events; another asks from time to time,
 * until it is looked at again.
 *
 * Listen to a project. `handlers` has the functions job(data), waiting(), photos(), objects(), scene(), and reconnected(), which is
 * called after a gap: events may be missing then, so the project must be read again. Return a function that ends it.
 */
export function listen(url, handlers) {
  let source = null;
  let timer = 0;
  let wait = FIRST_WAIT;
  let hadGap = false;
  let asking = 0;

  function open() {
    clearInterval(asking);
    asking = 0;
    source = new EventSource(url);
    source.onopen = () => {
      wait = FIRST_WAIT;
      if (hadGap) handlers.reconnected();
      hadGap = false;
    };
    source.onerror = () => {
      hadGap = true;
      suspect();
      // The browser reconnects by itself after a lost connection, but not after an error status.
      if (source.readyState !== EventSource.CLOSED) return;
      clearTimeout(timer);
      timer = setTimeout(open, wait);
      wait = Math.min(2 * wait, LONGEST_WAIT);
    };
    source.addEventListener("displaced", giveWay);
    for (const name of ["job", "waiting", "photos", "objects", "scene"]) {
      source.addEventListener(name, (event) => handlers[name](parsed(event.data)));
    }
  }

  function giveWay() {
    source.close();
    hadGap = true;
    asking = setInterval(() => handlers.reconnected(), ASK_EVERY);
  }

  const lookedAt = () => {
    if (asking && document.visibilityState === "visible") open();
  };
  document.addEventListener("visibilitychange", lookedAt);
  window.addEventListener("focus", lookedAt);
  open();
  return () => {
    document.removeEventListener("visibilitychange", lookedAt);
    window.removeEventListener("focus", lookedAt);
    clearInterval(asking);
    clearTimeout(timer);
    source.close();
  };
}

function parsed(text) {
  try {
    return JSON.parse(text);
  } catch {
    return {};
  }
}
