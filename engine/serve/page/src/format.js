// Numbers and times as words.
import { locale, plural, t } from "./language.js";

/** 75 -> "about 1 minute". Rough on purpose: estimates of the engine are. */
export function duration(seconds) {
  if (seconds < 50) return t("less than a minute");
  const minutes = Math.round(seconds / 60);
  if (minutes < 90) return plural(Math.max(1, minutes), "about {} minute", "about {} minutes");
  return plural(Math.round(minutes / 60), "about {} hour", "about {} hours");
}

export function megabytes(bytes) {
  return bytes < 1e6 ? `${Math.max(1, Math.round(bytes / 1e3))} kB` : `${decimal(bytes / 1e6)} MB`;
}

/** A number with one digit after the point, or the comma of the language. */
export function decimal(value) {
  return value.toLocaleString(locale(), { minimumFractionDigits: 1, maximumFractionDigits: 1 });
}

export function date(iso) {
  const time = new Date(iso);
  return Number.isNaN(time.getTime()) ? "" : time.toLocaleDateString(locale(), { year: "numeric", month: "long", day: "numeric" });
}

export function stateText(state) {
  const texts = {
    empty: t("No photos yet"),
    uploaded: t("Ready to reconstruct"),
    waiting: t("Waiting for its turn"),
    working: t("Working"),
    ready: t("Finished"),
    stopped: t("Stopped"),
    damaged: t("Its description is damaged: give it a new name"),
  };
  return texts[state] ?? state;
}

/** "cameras" -> "Finding where the photos were taken". `stages` are the names that the server has for them. */
export function stageText(stages, stage) {
  return stage ? t(stages[stage] ?? stage) : t("Starting");
}

/** [300, 720, 1500] seconds -> "Takes about 12 minutes, seldom longer than about 25 minutes." */
export function forecastText([, expected, high]) {
  const [usual, most] = [duration(expected), duration(high)];
  return usual === most ? t("Takes {}.", usual) : t("Takes {}, seldom longer than {}.", usual, most);
}

export function percent(fraction) {
  return `${Math.round(100 * fraction)} %`;
}
