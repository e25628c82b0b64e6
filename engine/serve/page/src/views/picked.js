// A click in the viewer becomes a click in the photo that shows the place best: a dot, and what can be done with it.
import { getPixel, startJob } from "../api.js";
import { announce, during, h, show } from "../dom.js";
import { t } from "../language.js";

const STILL = 5; // CSS pixels that a pointer may move and still click.

/**
 * Return {element, dot, listen(canvas, viewer, views), clear()}. `openPhoto(click)` opens the photo with the click set;
 * `isPickable()` says whether the whole scene is shown.
 */
export function createPicked(context, { openPhoto, isPickable }) {
  const { id } = context;
  let click = null; // {photo, x, y, wanted}, in pixels of the photo
  const button = (text, action, props) => {
    const made = h("button", { type: "button", onclick: () => during(made, action), ...props }, text);
    return made;
  };
  const isolate = button(t("Isolate it"), isolateIt);
  const element = h(
    "div",
    { class: "alone picked", role: "group", "aria-label": t("The clicked place"), hidden: true },
    h("span", null, t("Is this an object?")),
    isolate,
    button(t("Show in a photo"), async () => openPhoto(taken())),
    button("×", async () => clear(), { "aria-label": t("Forget the click") }),
  );
  const dot = h("span", { class: "picked-dot", "aria-hidden": "true", hidden: true });

  function taken() {
    const last = click;
    clear();
    return last;
  }

  async function isolateIt() {
    await startJob(id, { kind: "segment", clicks: [click], name: "" });
    clear();
    announce(t("The object is being computed."));
    await context.refresh();
  }

  function clear() {
    click = null;
    show(element, false);
    show(dot, false);
  }

  async function pick(event, canvas, viewer, views) {
    clear();
    const box = canvas.getBoundingClientRect();
    const place = [event.clientX - box.left, event.clientY - box.top];
    const point = isPickable() ? viewer.pick(...place) : null;
    if (!point) return;
    for (const view of viewer.viewsThatShow(point, views)) {
      const pixel = await getPixel(id, view.photo, point);
      if (!pixel) continue;
      click = { photo: view.photo, ...pixel, wanted: true };
      [dot.style.left, dot.style.top] = place.map((value) => `${value}px`);
      show(dot, true);
      show(element, true);
      announce(t("Clicked a place that {} shows. Isolate it, or show it in the photo.", view.photo));
      return;
    }
    announce(t("No photo shows this place."));
  }

  /** Follow the clicks on `canvas`; drags turn the camera. */
  function listen(canvas, viewer, views) {
    let start = null;
    canvas.addEventListener("pointerdown", (event) => (start = event.isPrimary ? [event.clientX, event.clientY] : null));
    canvas.addEventListener("click", (event) => {
      const isStill = start && Math.hypot(event.clientX - start[0], event.clientY - start[1]) <= STILL;
      if (isStill) pick(event, canvas, viewer, views()).catch(() => clear());
    });
  }

  return { element, dot, listen, clear };
}
