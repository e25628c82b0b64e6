// Choice of the preset and the one next step.
import { startJob } from "../api.js";
import { getForecast } from "../calls.js";
import { announce, during, h, newId, setText, show } from "../dom.js";
import { forecastText } from "../format.js";
import { isActive } from "../jobs.js";
import { t } from "../language.js";

function createOption(label, description) {
  const input = h("input", { type: "checkbox" });
  const words = h("span", null, h("strong", null, label), h("span", { class: "hint" }, description));
  return { input, element: h("label", { class: "choice" }, input, words) };
}

export function createReconstruct(context, photos) {
  const { id, session } = context;
  let project = null;
  const name = newId("preset");
  const times = new Map(); // preset -> where its time stands
  let forecastOf = ""; // the photos that the shown times are of
  const choices = session.presets.map(({ name: preset, label, description }) => {
    const input = h("input", { type: "radio", name, value: preset, checked: preset === session.default_preset });
    const time = h("span", { class: "hint time" });
    times.set(preset, time);
    return h("label", { class: "choice" }, input, h("span", null, h("strong", null, t(label)), h("span", { class: "hint" }, t(description)), time));
  });
  const masks = createOption(t("Leave out the background"), t("For an object on a turntable before a background that stands still."));
  const fisheye = createOption(t("Fisheye lens"), t("As of action cameras: straight edges look bent."));
  const light = createOption(t(session.light.label), `${t(session.light.description)}.`);
  const button = h("button", { type: "button", class: "main large", onclick: () => during(button, start) }, t("Reconstruct"));
  const note = h("p", { class: "hint", "aria-live": "polite" });
  const element = h(
    "section",
    { class: "card", "aria-label": t("Reconstruction") },
    h("fieldset", { class: "choices" }, h("legend", null, t("How good should it be?")), choices),
    masks.element,
    fisheye.element,
    light.element,
    h("div", { class: "next" }, button, note),
  );
  photos.onIdle(() => project && update(project));
  // The forecast costs the server some seconds, so it is made when somebody looks.
  const seen = new IntersectionObserver(([entry]) => entry.isIntersecting && project && update(project));
  seen.observe(element);

  async function start() {
    const preset = element.querySelector("input[type=radio]:checked").value;
    await startJob(id, {
      kind: "reconstruct", preset, mask_background: masks.input.checked, fisheye: fisheye.input.checked, light: light.input.checked,
    });
    announce(t("The reconstruction has started."));
    window.scrollTo({ top: 0 });
    await context.refresh();
  }

  function update(news) {
    project = news;
    const usable = project.photos.filter((photo) => photo.accepted !== false).length;
    let reason = "";
    if (photos.busy()) reason = t("Wait until all files are uploaded.");
    else if (usable < session.limits.fewest_photos && !hasVideo()) reason = t("Add more photos. At least {} are needed; 30 to 100 are best.", session.limits.fewest_photos);
    button.disabled = reason !== "";
    const advice = usable < 20 && !hasVideo() ? t("More photos give a better result. Best are 30 to 100.") : t("You can close this page meanwhile.");
    setText(note, reason || advice);
    // A stopped reconstruction has its own button, Continue, which is the better next step.
    const isStopped = project.job?.kind === "reconstruct" && project.job.state === "stopped";
    const isNext = !project.scene && !isStopped;
    setText(button, t(isNext ? "Reconstruct" : isStopped ? "Start again" : "Reconstruct again"));
    button.classList.toggle("large", isNext);
    button.classList.toggle("main", isNext);
    show(element, project.photos.length > 0 && !isActive(project.job));
    if (!reason && usable >= session.limits.fewest_photos) forecast();
  }

  /** Ask the server how long each preset takes, once for these photos and only where it is seen. */
  async function forecast() {
    const photosNow = project.photos.map((photo) => photo.name).join("/");
    if (forecastOf === photosNow || element.offsetParent === null) return;
    forecastOf = photosNow;
    const write = (of) => times.forEach((place, preset) => setText(place, of(preset)));
    write(() => t("How long it takes is being estimated…"));
    try {
      const seconds = await getForecast(id);
      if (forecastOf === photosNow) write((preset) => (seconds[preset] ? forecastText(seconds[preset]) : ""));
    } catch {
      write(() => ""); // The reconstruction itself says what is wrong.
    }
  }

  function hasVideo() {
    return project.videos.some((video) => !video.problem);
  }

  return { element, update, dispose: () => seen.disconnect() };
}
