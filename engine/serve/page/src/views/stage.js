// The viewer with its buttons and the strip of photos, each of which leads to its camera.
import { sceneUrl, viewUrl } from "../api.js";
import { getMembers } from "../calls.js";
import { announce, during, h, refill, roving, setText, show } from "../dom.js";
import { startViewer } from "../lazy_viewer.js";
import { createObjectLooks } from "../object_looks.js";
import { createTools, helpText } from "../tools.js";
import { createPicked } from "./picked.js";
import { t } from "../language.js";

/**
 * `sceneShown()` is called when the whole scene is shown again by a button here, `openPhoto(click)` to show a click of
 * the viewer in its photo, `looksChanged()` when objects are hidden, lit or dimmed.
 */
export function createStage(context, { sceneShown, openPhoto, looksChanged }) {
  const { id } = context;
  let viewer = null;
  let starting = null; // a promise of the viewer: a canvas bears only one
  let views = [];
  let unit = { metresPerUnit: null, text: "" };
  let photo = ""; // whose camera is used, "" after a movement
  let starts = 0;
  let disposed = false;

  const help = `${helpText()} ${t("A click on an object isolates it.")}`;
  const canvas = h("canvas", { tabindex: 0, role: "application", "aria-label": t("3D scene. {}", help) });
  const loading = h("p", { class: "loading", role: "status" }, t("Loading the scene…"));
  const aloneText = h("span");
  const whole = h("button", { type: "button", onclick: () => during(whole, showScene) }, t("Show the whole scene"));
  const alone = h("div", { class: "alone", hidden: true }, aloneText, whole);
  const looks = createObjectLooks(() => viewer, (object) => getMembers(id, object), looksChanged);
  const tools = createTools(canvas, {
    viewer: () => viewer,
    views: () => views,
    lookFrom,
    current: () => views.find((view) => view.photo === photo),
    home,
    unit: () => unit,
    file: () => "picture",
    frame: () => frame,
  });
  const picked = createPicked(context, { openPhoto, isPickable: () => alone.hidden && !tools.measure.isOn() });
  const box = h("div", { class: "canvas-box" }, canvas, tools.parts, picked.dot, loading, alone, picked.element);
  const frame = h("div", { class: "frame" }, box, tools.element);
  const strip = h("ul", { class: "strip", "aria-label": t("Look from a photo's place") });
  roving(strip, "button");
  const element = h(
    "div",
    { class: "stage" },
    frame,
    h("details", { class: "help" }, h("summary", null, t("How to move")), h("p", { class: "hint" }, help)),
    h("h2", { class: "strip-title" }, t("Look from where a photo was taken")),
    strip,
  );

  /** Show the scene with these cameras; called again when the scene changes. */
  async function start(cameras) {
    const turn = ++starts;
    ({ views, unit } = cameras);
    fillStrip();
    photo = "";
    show(loading, true);
    setText(loading, t("Loading the scene…"));
    try {
      starting ??= startStage();
      await starting;
      if (disposed || turn !== starts) return;
      viewer.setScene(cameras.center, cameras.radius, cameras.up);
      if (views.length > 0) lookFrom(views[0]);
      else viewer.frame(cameras.center, cameras.radius, cameras.up);
      await viewer.load(sceneUrl(id), (share) => setText(loading, t("Loading the scene… {} %", Math.round(100 * share))));
      if (turn !== starts) return;
      looks.reset();
      show(loading, false);
      box.dataset.ready = "true";
    } catch (error) {
      if (turn === starts) setText(loading, error.message);
    }
  }

  async function startStage() {
    try {
      viewer = await startViewer(canvas, { moved, wheelIgnored: tools.wheelIgnored });
    } catch (error) {
      starting = null;
      throw error;
    }
    if (disposed) return viewer.dispose();
    picked.listen(canvas, viewer, () => views);
    tools.listen();
  }

  function moved(isPhoto) {
    picked.clear();
    tools.moved();
    if (!isPhoto) mark("");
  }

  /** The view that the scene opened with; of an object that is shown alone, that side. */
  function home() {
    if (!alone.hidden) viewer.frameAlone(views);
    else if (views.length > 0) lookFrom(views[0]);
  }

  /** Light an object in the scene, and look from the place of a photo that shows it; with `scroll` the page follows. */
  async function point(object, scroll = false) {
    if (!viewer) return;
    if (scroll) box.scrollIntoView({ block: "nearest" });
    if (!alone.hidden) await showScene();
    await looks.light(object.id);
    const members = await looks.members(object.id);
    if (!viewer) return; // another project was opened meanwhile
    const view = viewer.lookAt(members, views);
    if (view) mark(view.photo);
    announce(t("{} is lit in the scene.", object.name));
  }

  function fillStrip() {
    refill(
      strip,
      ...views.map((view) => {
        const button = h(
          "button",
          { type: "button", "aria-label": t("Look from {}", view.photo), "aria-pressed": "false", onclick: () => viewer && lookFrom(view) },
          h("img", { src: viewUrl(id, view.photo, 320), alt: "", loading: "lazy" }),
        );
        button.dataset.photo = view.photo;
        return h("li", null, button);
      }),
    );
  }

  function lookFrom(view) {
    viewer.lookThrough(view);
    mark(view.photo);
  }

  function mark(name) {
    if (name === photo) return;
    photo = name;
    for (const button of strip.querySelectorAll("button")) {
      button.setAttribute("aria-pressed", String(button.dataset.photo === name));
    }
  }

  /** Show one object alone. */
  async function showObject(url, name) {
    if (!viewer) return;
    picked.clear();
    setText(loading, t("Loading {}…", name));
    show(loading, true);
    try {
      tools.measure.end();
      await viewer.showOnly(url);
      if (!viewer) return;
      viewer.frameAlone(views);
      setText(aloneText, t("{} alone", name));
      show(alone, true);
      announce(t("{} is shown alone.", name));
    } finally {
      show(loading, false);
    }
  }

  async function showScene() {
    if (!viewer) return;
    // Where the object was seen from: an orbit around it may have led behind a wall.
    const nearest = viewer.nearestView(views);
    tools.measure.end();
    const drawn = viewer.showOnly(null);
    if (nearest) lookFrom(nearest);
    await drawn;
    show(alone, false);
    sceneShown();
    announce(t("The whole scene is shown."));
  }

  function dispose() {
    disposed = true;
    viewer?.dispose();
    viewer = null; // what waits for an answer of the server finds nothing to draw on
  }

  return { element, start, showObject, showScene, point, looks, photo: () => photo, dispose };
}
