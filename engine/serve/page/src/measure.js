// A length between two places of the scene, by clicks or by keys.
import { h, refill, setText, show, svg } from "./dom.js";
import { length, sub } from "./vectors.js";
import { t } from "./language.js";

const CLICK = 4; // Pixels that the pointer may move during a click.

/**
 * Return {parts, button, isOn(), toggle(), end(), redraw(), listen()}. `parts` belong over the canvas. `unit()` returns
 * {metresPerUnit, text}, the metres null where they are not known.
 */
export function createMeasure(canvas, viewer, unit) {
  const line = svg("svg", { class: "line", "aria-hidden": "true" });
  const result = h("p", { class: "measured", role: "status", hidden: true });
  const cross = h("div", { class: "aim", hidden: true, "aria-hidden": "true" });
  const button = h("button", { type: "button", "aria-pressed": "false", onclick: () => viewer() && toggle() }, t("Measure"));
  let isOn = false;
  let points = [];

  function set(on) {
    isOn = on;
    points = [];
    button.setAttribute("aria-pressed", String(on));
    show(cross, on);
    show(result, on);
    setText(result, on ? t("Click two points, or press Enter to set one at the cross.") : "");
    redraw();
  }

  function toggle() {
    set(!isOn);
  }

  function setPoint(x, y) {
    const point = viewer().pick(x, y);
    if (!point) {
      setText(result, t("There is nothing at that place."));
      return;
    }
    if (points.length === 2) points = [];
    points.push(point);
    setText(result, points.length === 2 ? lengthText(length(sub(points[0], points[1])), unit()) : t("Now the second point."));
    redraw();
  }

  /** Draw the points where the camera sees them now. */
  function redraw() {
    const seen = viewer() ? points.map((point) => viewer().place(point)) : [];
    const shown = seen.filter((place) => place !== null);
    const shapes = shown.map(([x, y]) => svg("circle", { cx: x, cy: y, r: 5 }));
    if (shown.length === 2) {
      const [[x1, y1], [x2, y2]] = shown;
      shapes.unshift(svg("line", { x1, y1, x2, y2 }));
    }
    refill(line, shapes);
  }

  /** Follow clicks and Enter on the canvas while measuring is on. */
  function listen() {
    let pressed = null;
    canvas.addEventListener("pointerdown", (event) => (pressed = [event.clientX, event.clientY]));
    canvas.addEventListener("pointerup", (event) => {
      if (!isOn || !pressed) return;
      if (Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > CLICK) return;
      const { left, top } = canvas.getBoundingClientRect();
      setPoint(event.clientX - left, event.clientY - top);
    });
    new ResizeObserver(redraw).observe(canvas);
  }

  return {
    parts: [line, cross, result],
    button,
    isOn: () => isOn,
    toggle,
    end: () => isOn && set(false),
    setMiddle: () => isOn && setPoint(canvas.clientWidth / 2, canvas.clientHeight / 2),
    redraw,
    listen,
  };
}

/** The length in metres or, where the unit is not known, in units; three digits are more than a click can tell. */
function lengthText(units, { metresPerUnit, text }) {
  if (!metresPerUnit) return t("{} units. {}", units.toPrecision(3), t(text));
  const metres = units * metresPerUnit;
  if (metres < 0.01) return `${(metres * 1000).toPrecision(3)} mm`;
  return metres < 1 ? `${(metres * 100).toPrecision(3)} cm` : `${metres.toPrecision(3)} m`;
}
