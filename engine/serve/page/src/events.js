// Server-sent events of a project, with reconnection.
import { suspect } from "./connection.js";

const FIRST_WAIT = 2000;
const LONGEST_WAIT = 30000;

/**
 * Listen to a project. `handlers` has the functions job(data), waiting(), photos(), objects(), scene(), and reconnected(), which is
 * called after a gap: events may be missing then, so the project must be read again. Return a function that ends it.
 */
export function listen(url, handlers) {
  let source = null;
  let timer = 0;
  let wait = FIRST_WAIT;
  let hadGap = false;

  function open() {
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
    for (const name of ["job", "waiting", "photos", "objects", "scene"]) {
      source.addEventListener(name, (event) => handlers[name](parsed(event.data)));
    }
  }

  open();
  return () => {
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
