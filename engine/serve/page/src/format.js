// Numbers and times as words.

/** 75 -> "about 1 minute". Rough on purpose: estimates of the engine are. */
export function duration(seconds) {
  if (seconds < 50) return "less than a minute";
  const minutes = Math.round(seconds / 60);
  if (minutes < 90) return `about ${plural(Math.max(1, minutes), "minute")}`;
  return `about ${plural(Math.round(minutes / 60), "hour")}`;
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

const STAGES = {
  photos: "Checking the photos",
  frames: "Choosing pictures of the video",
  cameras: "Finding out where the photos were taken",
  masks: "Looking for outlines in the photos",
  training: "Building the 3D scene",
  objects: "Isolating objects",
  report: "Writing the report",
};

/** "cameras" -> "Finding out where the photos were taken". */
export function stageText(stage) {
  return STAGES[stage] ?? (stage ? stage[0].toUpperCase() + stage.slice(1) : "Starting");
}

/** [300, 720, 1500] seconds -> "about 12 minutes, at most about 25". */
export function forecastText([, expected, high]) {
  const most = duration(high);
  return duration(expected) === most ? duration(expected) : `${duration(expected)}, seldom more than ${most.replace("about ", "")}`;
}

export function percent(fraction) {
  return `${Math.round(100 * fraction)} %`;
}
