// The buttons and keys of the picture: zoom, views, measuring, saving, full screen. The page of the server and the page
// that an export writes have the same ones.
import { announce, during, h, show, svg } from "./dom.js";
import { createMeasure } from "./measure.js";
import { t } from "./language.js";

const HINT_MS = 1500;

/** How to move in the viewer. */
export function helpText() {
  return t(
    "Drag to turn, two fingers or Shift and drag to move, pinch or Ctrl and wheel to zoom. Keys: arrows turn, Shift and arrows move, + and − zoom, H leads to the first view, N and P to the next and previous view, M measures: Enter sets a point at the cross, Escape ends.",
  );
}

/**
 * Return {element, parts, measure, moved(), wheelIgnored(), listen()}: the buttons, and what belongs over the canvas.
 *
 * `viewer()` returns the viewer or null, `views()` those of the photos, `lookFrom(view)` looks through one, `current()`
 * returns the one that was looked through last. `home()` shows the first view. `unit()` see measure.js; `file` is the name
 * of a saved picture; `frame` is what becomes full screen.
 */
export function createTools(canvas, { viewer, views, lookFrom, current, home, unit, file, frame, more = [] }) {
  const measure = createMeasure(canvas, viewer, unit);
  const hint = h("p", { class: "wheel-hint", hidden: true, "aria-hidden": "true" }, t("Hold Ctrl and turn the wheel to zoom."));
  let hintTimer = 0;

  const tool = (text, action, props = {}) => {
    const button = h("button", { type: "button", onclick: () => viewer() && during(button, async () => action()), ...props }, text);
    return button;
  };
  const step = (by) => {
    const all = views();
    if (all.length === 0) return;
    const at = Math.max(0, all.indexOf(current() ?? viewer().nearestView(all)));
    const next = (at + by + all.length) % all.length;
    lookFrom(all[next]);
    announce(t("View {} of {}", next + 1, all.length));
  };
  const fullScreen = async () => {
    if (document.fullscreenElement) await document.exitFullscreen();
    else await frame().requestFullscreen();
  };
  const savePicture = async () => {
    const url = URL.createObjectURL(await viewer().picture());
    h("a", { href: url, download: `${file()}.png` }).click();
    setTimeout(() => URL.revokeObjectURL(url), 10000);
  };
  const named = (label) => ({ "aria-label": label, title: label });
  const element = h(
    "div",
    { class: "tools", role: "group", "aria-label": t("View") },
    tool("+", () => viewer().zoom(1 / 1.3), named(t("Zoom in"))),
    tool("−", () => viewer().zoom(1.3), named(t("Zoom out"))),
    tool(t("First view"), home),
    tool("‹", () => step(-1), named(t("Previous view"))),
    tool("›", () => step(1), named(t("Next view"))),
    measure.button,
    more,
    tool(t("Save picture"), savePicture),
    document.fullscreenEnabled ? tool(corners(), fullScreen, named(t("Full screen"))) : null,
  );

  function onKey(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || !viewer()) return;
    const actions = { m: measure.toggle, n: () => step(1), p: () => step(-1), h: home };
    if (measure.isOn()) Object.assign(actions, { Escape: measure.end, Enter: measure.setMiddle });
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action) return;
    event.preventDefault();
    action();
  }

  /** Say how to zoom, as a wheel over the picture scrolls the page. */
  function wheelIgnored() {
    show(hint, true);
    clearTimeout(hintTimer);
    hintTimer = setTimeout(() => show(hint, false), HINT_MS);
  }

  function listen() {
    measure.listen();
    canvas.addEventListener("keydown", onKey);
  }

  return { element, parts: [...measure.parts, hint], measure, moved: measure.redraw, wheelIgnored, listen };
}

/** The usual sign for full screen, drawn, because not every font has it. */
function corners() {
  const path = svg("path", { d: "M3 8V3h5M16 3h5v5M21 16v5h-5M8 21H3v-5" });
  return svg("svg", { viewBox: "0 0 24 24", "aria-hidden": "true" }, path);
}
