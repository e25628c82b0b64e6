// The viewer with its buttons and the strip of photos, each of which leads to its camera.
import { sceneUrl, viewUrl } from "../api.js";
import { announce, during, h, setText, show, svg } from "../dom.js";
import { startViewer } from "../lazy_viewer.js";
import { createPicked } from "./picked.js";

const HELP = "Drag to turn, two fingers or Shift and drag to move, scroll or pinch to zoom, click an object to isolate it. Keys: arrows turn, Shift and arrows move, + and − zoom.";

/**
 * `sceneShown()` is called when the whole scene is shown again by a button here, `openPhoto(click)` to show a click of
 * the viewer in its photo.
 */
export function createStage(context, { sceneShown, openPhoto }) {
  const { id } = context;
  let viewer = null;
  let views = [];
  let photo = ""; // whose camera is used, "" after a movement
  let starts = 0;
  let disposed = false;

  const canvas = h("canvas", { tabindex: 0, role: "application", "aria-label": `3D scene. ${HELP}` });
  const loading = h("p", { class: "loading", role: "status" }, "Loading the scene…");
  const aloneText = h("span");
  const whole = h("button", { type: "button", onclick: () => during(whole, showScene) }, "Show the whole scene");
  const alone = h("div", { class: "alone", hidden: true }, aloneText, whole);
  const tool = (label, text, action) => {
    const button = h("button", { type: "button", "aria-label": label, title: label, onclick: () => viewer && during(button, action) }, text);
    return button;
  };
  const tools = h(
    "div",
    { class: "tools", role: "group", "aria-label": "View" },
    tool("Zoom in", "+", async () => viewer.zoom(1 / 1.3)),
    tool("Zoom out", "−", async () => viewer.zoom(1.3)),
    tool("Fit", "Fit", async () => viewer.frameShown()),
    tool("Save picture", "Save picture", savePicture),
    document.fullscreenEnabled ? tool("Full screen", corners(), fullScreen) : null,
  );
  const picked = createPicked(context, { openPhoto, isPickable: () => alone.hidden });
  const box = h("div", { class: "canvas-box" }, canvas, picked.dot, loading, alone, picked.element, tools);
  const strip = h("ul", { class: "strip", "aria-label": "Look from a photo's place", tabindex: 0 });
  const element = h(
    "div",
    { class: "stage" },
    box,
    h("p", { class: "hint" }, HELP),
    h("h2", { class: "strip-title" }, "Look from where a photo was taken"),
    strip,
  );

  /** Show the scene with these cameras; called again when the scene changes. */
  async function start(cameras) {
    const turn = ++starts;
    views = cameras.views;
    fillStrip();
    show(loading, true);
    setText(loading, "Loading the scene…");
    try {
      if (!viewer) {
        viewer = await startViewer(canvas, { moved });
        picked.listen(canvas, viewer, () => views);
      }
      if (disposed) return viewer.dispose();
      viewer.setScene(cameras.center, cameras.radius, cameras.up);
      if (views.length > 0) lookFrom(views[0]);
      else viewer.frame(cameras.center, cameras.radius, cameras.up);
      await viewer.load(sceneUrl(id), (share) => setText(loading, `Loading the scene… ${Math.round(100 * share)} %`));
      if (turn === starts) show(loading, false);
      box.dataset.ready = "true";
    } catch (error) {
      setText(loading, error.message);
    }
  }

  function moved(isPhoto) {
    picked.clear();
    if (!isPhoto) mark("");
  }

  function fillStrip() {
    strip.replaceChildren(
      ...views.map((view) => {
        const button = h(
          "button",
          { type: "button", "aria-label": `Look from ${view.photo}`, "aria-pressed": "false", onclick: () => viewer && lookFrom(view) },
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
    setText(loading, `Loading ${name}…`);
    show(loading, true);
    try {
      await viewer.showOnly(url);
      viewer.frameShown();
      setText(aloneText, `${name} alone`);
      show(alone, true);
      announce(`${name} is shown alone.`);
    } finally {
      show(loading, false);
    }
  }

  async function showScene() {
    if (!viewer) return;
    await viewer.showOnly(null);
    viewer.frameShown();
    show(alone, false);
    sceneShown();
    announce("The whole scene is shown.");
  }

  async function savePicture() {
    const url = URL.createObjectURL(await viewer.picture());
    h("a", { href: url, download: "picture.png" }).click();
    setTimeout(() => URL.revokeObjectURL(url), 10000);
  }

  async function fullScreen() {
    if (document.fullscreenElement) await document.exitFullscreen();
    else await box.requestFullscreen();
  }

  function dispose() {
    disposed = true;
    viewer?.dispose();
  }

  return { element, start, showObject, showScene, photo: () => photo, dispose };
}

/** The usual sign for full screen, drawn, because not every font has it. */
function corners() {
  const path = svg("path", { d: "M3 8V3h5M16 3h5v5M21 16v5h-5M8 21H3v-5" });
  return svg("svg", { viewBox: "0 0 24 24", "aria-hidden": "true" }, path);
}
