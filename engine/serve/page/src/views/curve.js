// A small curve of the quality (PSNR) against the time.
import { h, refill, show, svg } from "../dom.js";
import { decimal } from "../format.js";
import { t } from "../language.js";

const WIDTH = 320;
const HEIGHT = 150;
const LEFT = 40;
const BOTTOM = 24;
const TOP = 10;
const RIGHT = 12;

export function createCurve() {
  const drawing = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", class: "curve" });
  const element = h("figure", { hidden: true }, drawing, h("figcaption", { class: "hint" }, t("Quality (PSNR in dB) against seconds of training")));
  let drawn = "";

  function update(points) {
    show(element, points.length > 1);
    const key = `${points.length}|${points.at(-1)}`;
    if (points.length < 2 || key === drawn) return;
    drawn = key;
    const [seconds, quality] = points.at(-1);
    drawing.setAttribute("aria-label", t("Quality {} dB after {} seconds", decimal(quality), Math.round(seconds)));
    refill(drawing, ...shapes(points));
  }

  return { element, update };
}

function shapes(points) {
  const times = points.map((point) => point[0]);
  const values = points.map((point) => point[1]);
  const last = Math.max(...times, 1);
  const low = Math.floor(Math.min(...values));
  const high = Math.max(Math.ceil(Math.max(...values)), low + 1);
  const x = (time) => LEFT + ((WIDTH - LEFT - RIGHT) * time) / last;
  const y = (value) => TOP + ((HEIGHT - TOP - BOTTOM) * (high - value)) / (high - low);
  const label = (text, at, anchor) => svg("text", { x: at[0], y: at[1], "text-anchor": anchor }, text);
  const line = points.map(([time, value]) => `${x(time).toFixed(1)},${y(value).toFixed(1)}`).join(" ");
  return [
    ...[low, high].map((value) => svg("line", { class: "grid", x1: LEFT, x2: WIDTH - RIGHT, y1: y(value), y2: y(value) })),
    svg("polyline", { class: "line", points: line }),
    svg("circle", { class: "dot", cx: x(times.at(-1)), cy: y(values.at(-1)), r: 3.5 }),
    label(`${high} dB`, [LEFT - 4, y(high) + 4], "end"),
    label(`${low} dB`, [LEFT - 4, y(low) + 4], "end"),
    label("0 s", [LEFT, HEIGHT - 6], "middle"),
    label(`${Math.round(last)} s`, [WIDTH - RIGHT, HEIGHT - 6], "end"),
  ];
}
