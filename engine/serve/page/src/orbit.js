// The camera that a person moves around a point with mouse, fingers or keys. It knows nothing of the renderer.
//
// A pose is {eye, right, down, forward}: the position and axes of a COLMAP camera (x right, y down, z forward).
import { add, cross, dot, length, perpendicular, scale, sub, unit } from "./vectors.js";

const STEEPEST = (88 * Math.PI) / 180; // Beyond, "up" would flip.
const TURN = 0.006; // Radians per pixel of a drag.
const KEY_TURN = 0.12; // Radians per key press.
const KEY_MOVE = 0.05; // Share of the picture per key press.
const KEY_ZOOM = 1.15;

/** Return the pose of a row-major world-to-camera matrix. */
export function poseOf(matrix) {
  const right = matrix.slice(0, 3);
  const down = matrix.slice(4, 7);
  const forward = matrix.slice(8, 11);
  const t = [matrix[3], matrix[7], matrix[11]];
  const eye = scale(add(add(scale(right, t[0]), scale(down, t[1])), scale(forward, t[2])), -1);
  return { eye, right, down, forward };
}

/** Return a pose at `eye` that looks at `target`, upright. */
function lookAt(eye, target, up) {
  const forward = unit(sub(target, eye));
  const right = unit(cross(forward, up));
  return { eye, right, down: cross(forward, right), forward };
}

/**
 * Move the camera by the events of `canvas`. `moved(pose)` is called after each change. `pixels()` returns the focal
 * length in CSS pixels, so that a panned point stays under the finger. `wheelIgnored()` is called for a wheel that was left
 * to the page.
 */
export function createOrbit(canvas, moved, pixels, wheelIgnored) {
  let up = [0, 0, 1];
  let target = [0, 0, 0];
  let distance = 1;
  let yaw = 0;
  let pitch = 0;
  let radius = 1;

  function frame() {
    const east = perpendicular(up);
    return [east, cross(up, east)];
  }

  function pose() {
    const [east, north] = frame();
    const level = add(scale(east, Math.cos(yaw)), scale(north, Math.sin(yaw)));
    const towards = add(scale(level, Math.cos(pitch)), scale(up, Math.sin(pitch)));
    return lookAt(add(target, scale(towards, distance)), target, up);
  }

  function changed() {
    moved(pose());
  }

  /** Use the scene's vertical and size for all later movements. */
  function setScene(sceneUp, sceneRadius) {
    up = unit(sceneUp);
    radius = sceneRadius;
  }

  /** Go on from a camera; `near` is the point of interest, which gives the distance of the point to turn around. */
  function from({ eye, forward }, near) {
    const depth = dot(sub(near, eye), forward);
    aim(eye, add(eye, scale(forward, Math.max(depth, 0.1 * radius))));
  }

  function aim(eye, newTarget) {
    const [east, north] = frame();
    const offset = sub(eye, newTarget);
    target = newTarget;
    distance = length(offset);
    pitch = clamp(Math.asin(clamp(dot(offset, up) / distance, 1)), STEEPEST);
    yaw = Math.atan2(dot(offset, north), dot(offset, east));
  }

  /** Look at a sphere from the present direction, so that it fills the picture. */
  function frameSphere(center, size, halfAngle) {
    target = center;
    distance = (1.1 * size) / Math.sin(halfAngle);
    changed();
  }

  function turn(dx, dy) {
    yaw -= dx;
    pitch = clamp(pitch + dy, STEEPEST);
    changed();
  }

  /** Move the picture by pixels. */
  function pan(dx, dy) {
    const { right, down } = pose();
    const step = distance / pixels();
    target = sub(target, add(scale(right, dx * step), scale(down, dy * step)));
    changed();
  }

  function zoom(factor) {
    distance = Math.min(Math.max(distance * factor, 0.03 * radius), 30 * radius);
    changed();
  }

  const forget = addInput(canvas, { turn, pan, zoom, wheelIgnored });
  return { setScene, from, frameSphere, zoom, pose, dispose: forget };
}

function clamp(value, limit) {
  return Math.min(Math.max(value, -limit), limit);
}

/** Translate events to turn, pan and zoom. Return a function that removes the listeners. */
function addInput(canvas, { turn, pan, zoom, wheelIgnored }) {
  const pointers = new Map();
  const ending = new AbortController();
  const on = (name, action) => canvas.addEventListener(name, action, { signal: ending.signal, passive: false });

  on("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
  });
  for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) {
    on(name, (event) => pointers.delete(event.pointerId));
  }
  on("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    const dx = now[0] - before[0];
    const dy = now[1] - before[1];
    if (pointers.size === 1) {
      pointers.set(event.pointerId, now);
      const moves = event.shiftKey || event.ctrlKey || (event.buttons & 6) !== 0; // Right or middle button.
      if (moves) pan(dx, dy);
      else turn(dx * TURN, dy * TURN);
      return;
    }
    // Two fingers: their middle pans, their distance zooms.
    const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
    const gap = (point) => Math.max(Math.hypot(point[0] - other[0], point[1] - other[1]), 1);
    pointers.set(event.pointerId, now);
    pan(dx / 2, dy / 2);
    zoom(gap(before) / gap(now));
  });
  on("wheel", (event) => {
    // A page that is scrolled must not stop at the picture. Ctrl is also what browsers report for a touchpad's pinch.
    if (!event.ctrlKey && !event.metaKey && !document.fullscreenElement) return wheelIgnored();
    event.preventDefault();
    // A wheel reports lines or pixels, a touchpad many small steps.
    const steps = clamp(event.deltaMode === 1 ? event.deltaY * 30 : event.deltaY, 200);
    zoom(Math.exp(steps * 0.0015));
  });
  on("contextmenu", (event) => event.preventDefault());
  on("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const action = keyAction(event, canvas, { turn, pan, zoom });
    if (!action) return;
    event.preventDefault();
    action();
  });
  return () => ending.abort();
}

function keyAction(event, canvas, { turn, pan, zoom }) {
  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  if (event.key === "+" || event.key === "=") return () => zoom(1 / KEY_ZOOM);
  if (event.key === "-") return () => zoom(KEY_ZOOM);
  if (!arrows[event.key]) return null;
  const [x, y] = arrows[event.key];
  if (!event.shiftKey) return () => turn(x * KEY_TURN, y * KEY_TURN);
  const step = KEY_MOVE * canvas.clientWidth;
  return () => pan(-x * step, -y * step);
}
