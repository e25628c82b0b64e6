// Numbers and times as words.

/** 75 -> "about 1 minute". Rough on purpose: estimates of the engine are. */
export function duration(seconds) {
  if (seconds < 50) return "less than a minute";
  const minutes = Math.round(seconds / 60);
  if (minutes < 90) return `about ${plural(Math.max(1, minutes), "minute")}`;
  return `about ${plural(Math.round(minutes / 60), "hour")}`;
}

/** The name of a format in a button: "PLY", or "page" for HTML. */
export function formatName(format) {
  return format === "html" ? "page" : format.toUpperCase();
}

export function plural(count, word) {
  return `${count.toLocaleString("en")} ${word}${count === 1 ? "" : "s"}`;
}

export function megabytes(bytes) {
  return bytes < 1e6 ? `${Math.max(1, Math.round(bytes / 1e3))} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
}

export function date(iso) {
  const time = new Date(iso);
  return Number.isNaN(time.getTime()) ? "" : time.toLocaleDateString(undefined, { year: "numeric", month: "long", day: "numeric" });
}

const STATES = {
  empty: "No photos yet",
  uploaded: "Ready to reconstruct",
  waiting: "Waiting for its turn",
  working: "Working",
  ready: "Finished",
  stopped: "Stopped",
  damaged: "Its description is damaged: give it a new name",
};

export function stateText(state) {
  return STATES[state] ?? state;
}

export function percent(fraction) {
  return `${Math.round(100 * fraction)} %`;
}
