// The job that runs: stage, bar, time left, live picture, curve, Stop and Continue.
import { continueJob, previewUrl, stopJob } from "../api.js";
import { announce, confirmed, during, h, refill, setText, show } from "../dom.js";
import { duration, percent, stageText } from "../format.js";
import { createAsk } from "./ask.js";
import { createCurve } from "./curve.js";
import { isActive, jobName } from "../jobs.js";
import { createTellMe } from "./tell_me.js";
import { said, t } from "../language.js";

const PICTURE_EVERY = 2000; // Milliseconds between live pictures at least.

/** `compact` leaves out the picture, the curve and the words for it; jobs of objects have none. */
export function createProgress(context, { compact = false } = {}) {
  const { id, session } = context;
  let job = null;
  let announced = "";
  let lastPicture = 0;

  const heading = h(compact ? "h3" : "h2");
  const stage = h("p", { class: "stage" });
  const left = h("p", { class: "quiet" });
  const bar = h("progress", { max: 1, "aria-label": t("Progress") });
  const message = h("p");
  const warnings = h("ul", { class: "warnings" });
  const picture = h("img", { class: "preview", alt: t("The scene so far"), hidden: true });
  const curve = createCurve();
  const ask = createAsk(context);
  const stop = h("button", { type: "button", onclick: () => during(stop, stopThis) }, t("Stop"));
  const tellMe = createTellMe();
  const goOn = h("button", { type: "button", class: "main", onclick: () => during(goOn, continueThis) }, t("Continue"));
  const dismiss = h("button", { type: "button", onclick: () => during(dismiss, dismissThis) }, t("Dismiss"));
  const queue = h("ul", { class: "queue" });
  const element = h(
    "section",
    { class: compact ? "job" : "card job", "aria-label": t("Progress"), hidden: true },
    heading,
    bar,
    h("div", { class: "row apart" }, stage, left),
    message,
    warnings,
    compact ? null : h("div", { class: "live" }, picture, curve.element),
    compact ? null : ask.element,
    h("div", { class: "row" }, goOn, stop, dismiss, tellMe.button),
    queue,
  );

  async function stopThis() {
    if (!compact) {
      const sure = await confirmed(t("Stop the reconstruction?"), t("What is computed so far is kept. You can continue later."), t("Stop"));
      if (!sure) return;
    }
    await stopJob(id, job.id);
    await context.refresh();
  }

  async function dismissThis() {
    await stopJob(id, job.id);
    await context.refresh();
  }

  async function continueThis() {
    await continueJob(id, job.id);
    await context.refresh();
  }

  function update(newJob, waiting = []) {
    if (isActive(job) && newJob?.id === job.id && !isActive(newJob)) tellMe.ended(endOf(newJob));
    job = newJob;
    const active = isActive(job);
    const stopped = job?.state === "stopped" || Boolean(job?.error);
    const others = waiting.filter((each) => each.id !== job?.id);
    show(element, active || stopped || others.length > 0);
    updateQueue(others);
    for (const part of [heading, bar, stage, left, message, warnings]) show(part, active || stopped);
    show(stop, active);
    tellMe.update(active && !compact);
    show(goOn, stopped);
    setText(goOn, t(job?.error ? "Try again" : "Continue"));
    show(dismiss, stopped && compact);
    ask.update(job ?? {});
    if (!active && !stopped) return;

    setText(heading, headingOf(job));
    const running = job.state === "running";
    if (running) bar.value = job.fraction ?? 0;
    show(bar, running);
    setText(stage, running ? `${stageText(session.stages, job.stage)} · ${percent(job.fraction ?? 0)}` : "");
    setText(left, running ? leftText(job) : "");
    setText(message, said(job.error || job.message) || waitingText(job));
    message.className = job.error ? "problem" : "";
    const texts = (job.warnings ?? []).join("\n");
    if (warnings.key !== texts) {
      warnings.key = texts;
      refill(warnings, ...(job.warnings ?? []).map((text) => h("li", null, said(text))));
    }
    if (!compact) {
      curve.update(job.curve ?? []);
      updatePicture();
    }
    say();
  }

  function updateQueue(others) {
    const key = others.map((each) => each.id).join("|");
    if (queue.key === key) return;
    queue.key = key;
    refill(
      queue,
      ...others.map((each) => {
        const remove = async () => {
          await stopJob(id, each.id);
          await context.refresh();
        };
        const button = h("button", { type: "button", class: "plain", onclick: () => during(button, remove) }, t("Remove"));
        return h("li", { class: "row apart" }, h("span", null, t("Next: {}", jobName(each))), button);
      }),
    );
  }

  /** Load the next live picture before it replaces the last one, so that it does not flicker. */
  function updatePicture() {
    if (!job.preview) show(picture, false);
    const now = Date.now();
    if (!job.preview || now - lastPicture < PICTURE_EVERY) return;
    lastPicture = now;
    const next = new Image();
    next.onload = () => {
      picture.src = next.src;
      show(picture, true);
    };
    next.src = previewUrl(id, now);
  }

  /** Screen readers hear each stage, each quarter and the end, not every step. */
  function say() {
    const quarter = Math.floor(4 * (job.fraction ?? 0)) * 25;
    const text = job.state === "running" ? `${stageText(session.stages, job.stage)}, ${quarter} %` : headingOf(job);
    if (text !== announced) announce(text);
    announced = text;
  }

  return { element, update };
}

function headingOf(job) {
  const name = jobName(job);
  if (job.error) return t("{}: could not be finished", name);
  if (job.state === "stopped") return t("{}: stopped", name);
  if (job.state === "waiting") return t("{}: waiting", name);
  return name;
}

/** The time left for all of the work; before there is a forecast, that of the stage. */
function leftText(job) {
  if (typeof job.seconds_left_in_all === "number") return t("{} left in all", duration(job.seconds_left_in_all));
  return typeof job.seconds_left === "number" ? t("{} left for this step", duration(job.seconds_left)) : "";
}

function endOf(job) {
  return job.state === "finished" ? t("{}: finished", jobName(job)) : headingOf(job);
}

function waitingText(job) {
  return job.state === "waiting" && !job.message ? t("The server is busy with other work. This starts by itself.") : "";
}
