// The two buttons of an object in a list: one lights it in the scene and looks at it, one hides it. The page of the server
// and the page that an export writes have the same ones.
import { during, h, put, refill, svg } from "./dom.js";
import { t } from "./language.js";

/**
 * Return {element, update()}. `looks` is of object_looks.js, `object()` returns {id, name}, `point(object)` lights it and
 * looks at it; `content` is what the first button shows.
 */
export function createObjectButtons(looks, object, point, content) {
  const light = h("button", { type: "button", class: "point", onclick: () => during(light, pointOut) }, content);
  const eye = h("button", { type: "button", class: "eye", onclick: () => during(eye, () => looks.setHidden(object().id, !looks.isHidden(object().id))) });
  const element = h("div", { class: "head" }, light, eye);

  /** A second press puts the light out. */
  function pointOut() {
    return looks.lit() === object().id ? looks.light(null) : point(object());
  }

  function update() {
    const { id, name } = object();
    const isLit = looks.lit() === id;
    light.setAttribute("aria-pressed", String(isLit));
    light.title = t(isLit ? "Put the light out" : "Light it in the scene and look at it");
    const label = t(looks.isHidden(id) ? "Show {}" : "Hide {}", name);
    eye.setAttribute("aria-label", label);
    eye.title = label;
    refill(eye, eyeShape(looks.isHidden(id)));
  }

  return { element, update };
}

/** An open eye, or one with a bar through it. */
function eyeShape(isHidden) {
  const drawing = svg("svg", { viewBox: "0 0 24 24", "aria-hidden": "true" });
  put(drawing, svg("path", { d: "M2 12s4-7 10-7 10 7 10 7-4 7-10 7S2 12 2 12z" }), svg("circle", { cx: 12, cy: 12, r: 3 }));
  if (isHidden) put(drawing, svg("path", { d: "M4 20L20 4" }));
  return drawing;
}
