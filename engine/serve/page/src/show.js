// A page of its own that shows one scene or object, with its record: everything that it needs is inside of the file.
import { announce, h, setText, show } from "./dom.js";
import { length, sub } from "./vectors.js";

const HELP =
  "Drag to turn, two fingers or Shift and drag to move, scroll or pinch to zoom. Keys: arrows turn, Shift and arrows move, + and − zoom, N and P go to the next and previous view, M measures: Enter sets a point at the cross, Escape ends.";
const CLICK = 4; // Pixels that the pointer may move during a click.

const data = JSON.parse(document.getElementById("data").textContent);
const canvas = h("canvas", { tabindex: 0, role: "application", "aria-label": `${data.title} in 3D. ${HELP}` });
const loading = h("p", { class: "loading", role: "status" }, "Loading…");
const line = document.createElementNS("http://www.w3.org/2000/svg", "svg");
const result = h("p", { class: "measured", role: "status", hidden: true });
const cross = h("div", { class: "cross", hidden: true, "aria-hidden": "true" });
const tool = (text, action, props = {}) => h("button", { type: "button", onclick: () => viewer && action(), ...props }, text);
const measureButton = tool("Measure", () => setMeasuring(!measuring), { "aria-pressed": "false" });
const tools = h(
  "div",
  { class: "tools", role: "group", "aria-label": "View" },
  tool("+", () => viewer.zoom(1 / 1.3), { "aria-label": "Zoom in" }),
  tool("−", () => viewer.zoom(1.3), { "aria-label": "Zoom out" }),
  tool("Previous view", () => lookFrom(view - 1)),
  tool("Next view", () => lookFrom(view + 1)),
  measureButton,
  tool("Save picture", savePicture),
  document.fullscreenEnabled ? tool("Full screen", fullScreen) : null,
);
line.setAttribute("aria-hidden", "true");
line.classList.add("line");
const box = h("div", { class: "canvas-box" }, canvas, line, cross, result, loading);
const frame = h("div", { class: "frame" }, box, tools);
document.getElementById("stage").replaceChildren(frame, h("p", { class: "hint" }, HELP));

let viewer = null;
let view = 0;
let measuring = false;
let points = [];

try {
  const module = URL.createObjectURL(new Blob([await unpacked("viewer")], { type: "text/javascript" }));
  const { createViewer } = await import(module);
  viewer = await createViewer(canvas, { moved: drawLine });
  viewer.setScene(data.center, data.radius, data.up);
  lookFrom(0);
  const url = URL.createObjectURL(await unpacked("splats"));
  await viewer.load(url, (share) => setText(loading, `Loading… ${Math.round(100 * share)} %`));
  URL.revokeObjectURL(url);
  show(loading, false);
  box.dataset.ready = "true";
  listen();
} catch (error) {
  setText(loading, error.message);
}

/** Return what a script element of the page holds, gzip in Base64, as a Blob. */
async function unpacked(id) {
  const element = document.getElementById(id);
  const response = await fetch(`data:application/gzip;base64,${element.textContent.trim()}`);
  element.remove();
  return new Response(response.body.pipeThrough(new DecompressionStream("gzip"))).blob();
}

function lookFrom(number) {
  view = (number + data.views.length) % data.views.length;
  viewer.lookThrough(data.views[view]);
  drawLine();
  announce(`View ${view + 1} of ${data.views.length}`);
}

function listen() {
  let pressed = null;
  canvas.addEventListener("pointerdown", (event) => (pressed = [event.clientX, event.clientY]));
  canvas.addEventListener("pointerup", (event) => {
    if (!measuring || !pressed) return;
    if (Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > CLICK) return;
    const { left, top } = canvas.getBoundingClientRect();
    setPoint(event.clientX - left, event.clientY - top);
  });
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const actions = {
      m: () => setMeasuring(!measuring),
      n: () => lookFrom(view + 1),
      p: () => lookFrom(view - 1),
      Escape: () => setMeasuring(false),
      Enter: () => measuring && setPoint(canvas.clientWidth / 2, canvas.clientHeight / 2),
    };
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action) return;
    event.preventDefault();
    action();
  });
  new ResizeObserver(drawLine).observe(canvas);
}

function setMeasuring(on) {
  measuring = on;
  points = [];
  measureButton.setAttribute("aria-pressed", String(on));
  show(cross, on);
  show(result, on);
  setText(result, on ? "Click two points, or press Enter to set one at the cross." : "");
  drawLine();
}

function setPoint(x, y) {
  const point = viewer.pick(x, y);
  if (!point) {
    setText(result, "There is nothing at that place.");
    return;
  }
  if (points.length === 2) points = [];
  points.push(point);
  setText(result, points.length === 2 ? lengthText(length(sub(points[0], points[1]))) : "Now the second point.");
  drawLine();
}

/** The length in metres or, where the unit is not known, in units; three digits are more than a click can tell. */
function lengthText(units) {
  if (!data.metresPerUnit) return `${units.toPrecision(3)} units. ${data.unit}`;
  const metres = units * data.metresPerUnit;
  if (metres < 0.01) return `${(metres * 1000).toPrecision(3)} mm`;
  return metres < 1 ? `${(metres * 100).toPrecision(3)} cm` : `${metres.toPrecision(3)} m`;
}

function drawLine() {
  const seen = viewer ? points.map((point) => viewer.place(point)) : [];
  const shown = seen.filter((place) => place !== null);
  const shapes = shown.map(([x, y]) => shape("circle", { cx: x, cy: y, r: 5 }));
  if (shown.length === 2) {
    const [[x1, y1], [x2, y2]] = shown;
    shapes.unshift(shape("line", { x1, y1, x2, y2 }));
  }
  line.replaceChildren(...shapes);
}

function shape(name, attributes) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return element;
}

async function savePicture() {
  const url = URL.createObjectURL(await viewer.picture());
  h("a", { href: url, download: `${data.file}.png` }).click();
  setTimeout(() => URL.revokeObjectURL(url), 10000);
}

async function fullScreen() {
  if (document.fullscreenElement) await document.exitFullscreen();
  else await frame.requestFullscreen();
}
