// Which point of the scene a ray hits. It knows nothing of the renderer, except the names of the PLY properties.
import { add, cross, dot, scale, sub, unit } from "./vectors.js";

const HIT = 0.5; // The ray ends where half of its light is blocked, as the median depth of 3DGS methods.
const NEAR_ENOUGH = 0.05; // Share of the distance by which a point may lie behind what a photo shows in front of it.
const ALPHA_MIN = 1 / 255;
const MOST_VIEWS = 16; // Views that are looked at for an object, the nearest ones.

/**
 * Return the distance along a ray where half of its light is blocked, or null where it is not.
 *
 * `splats` is PlayCanvas' GSplatData, with the properties of a 3DGS PLY file; `direction` has length 1. Each Gaussian
 * blocks opacity * exp(-d^2 / 2) of the light, with d the smallest distance from its centre in standard deviations
 * along the ray, at the place where it is smallest.
 */
export function hitDistance(splats, eye, direction) {
  const property = (name) => splats.getProp(name);
  const [x, y, z, opacity] = ["x", "y", "z", "opacity"].map(property);
  const [qw, qx, qy, qz] = [0, 1, 2, 3].map((i) => property(`rot_${i}`));
  const logScales = [0, 1, 2].map((i) => property(`scale_${i}`));
  const hits = []; // [distance, alpha]
  for (let i = 0; i < splats.numSplats; i += 1) {
    const offset = [x[i] - eye[0], y[i] - eye[1], z[i] - eye[2]];
    const along = dot(offset, direction);
    const sizes = logScales.map((values) => Math.exp(values[i]));
    // Three standard deviations and more: nothing to see, and most Gaussians end here.
    const reach = 3.4 * Math.max(...sizes);
    if (along < -reach || dot(offset, offset) - along * along > reach * reach) continue;
    const [o, d] = [offset, direction].map((v) => unrotated(v, qw[i], qx[i], qy[i], qz[i]).map((value, axis) => value / sizes[axis]));
    const t = dot(o, d) / dot(d, d);
    if (t <= 0) continue;
    const miss = sub(o, scale(d, t));
    const alpha = Math.exp(-dot(miss, miss) / 2) / (1 + Math.exp(-opacity[i]));
    if (alpha > ALPHA_MIN) hits.push([t, alpha]);
  }
  hits.sort((a, b) => a[0] - b[0]);
  let light = 1;
  for (const [t, alpha] of hits) {
    light *= 1 - alpha;
    if (light < HIT) return t;
  }
  return null;
}

/** Return `v` in the axes of a Gaussian: rotated by the inverse of its quaternion, which need not have length 1. */
function unrotated(v, w, x, y, z) {
  const norm = Math.hypot(w, x, y, z) || 1;
  const axis = [-x / norm, -y / norm, -z / norm];
  const t = scale(cross(axis, v), 2);
  return add(add(v, scale(t, w / norm)), cross(axis, t));
}

/** Return the ray through a pixel of a camera: {eye, direction}. `f` and `c` are its intrinsics, `pose` as of orbit.js. */
export function rayThrough({ eye, right, down, forward }, f, c, pixel) {
  const across = [0, 1].map((axis) => (pixel[axis] - c[axis]) / f[axis]);
  return { eye, direction: unit(add(forward, add(scale(right, across[0]), scale(down, across[1])))) };
}

/**
 * Return the views whose photos show `point`, those that look at it most like `eye` first. `poseOf` gives the pose of a
 * view. A view shows the point where it lies in the picture without lens distortion and nothing hides it.
 */
export function viewsOf(point, eye, views, poseOf, splats) {
  const towards = unit(sub(point, eye));
  return views
    .map((view) => {
      const pose = poseOf(view.world_to_camera);
      const offset = sub(point, pose.eye);
      return { view, pose, offset, likeness: dot(unit(offset), towards) };
    })
    .filter(({ view, pose, offset }) => isInPicture(view, pose, offset))
    .sort((a, b) => b.likeness - a.likeness)
    .filter(({ pose, offset }) => {
      const distance = Math.hypot(...offset);
      const hit = hitDistance(splats, pose.eye, scale(offset, 1 / distance));
      return hit !== null && hit > distance * (1 - NEAR_ENOUGH);
    })
    .map(({ view }) => view);
}

function isInPicture(view, pose, offset) {
  const depth = dot(offset, pose.forward);
  if (depth <= 0) return false;
  const u = (view.fx * dot(offset, pose.right)) / depth + view.cx;
  const v = (view.fy * dot(offset, pose.down)) / depth + view.cy;
  return u >= 0 && u < view.width && v >= 0 && v < view.height;
}

/** Return the view whose photo shows `point` largest: the nearest of those that have it in the picture; null without one. */
export function nearestTo(point, views, poseOf) {
  let best = null;
  for (const view of views) {
    const pose = poseOf(view.world_to_camera);
    const offset = sub(point, pose.eye);
    const size = view.fx / (Math.hypot(...offset) * view.width);
    if (isInPicture(view, pose, offset) && (!best || size > best.size)) best = { view, size };
  }
  return best?.view ?? null;
}

/**
 * Return the view that shows most of `points`, a sample of an object in the sphere {center, radius}, and of equal ones the
 * nearest; null without one that shows any.
 */
export function viewOfObject(points, { center, radius }, views, poseOf, splats) {
  const near = views
    .map((view) => ({ view, pose: poseOf(view.world_to_camera) }))
    .map((one) => ({ ...one, distance: Math.hypot(...sub(center, one.pose.eye)) }))
    .filter(({ view, pose }) => points.some((point) => isInPicture(view, pose, sub(point, pose.eye))))
    .sort((a, b) => a.distance - b.distance)
    .slice(0, MOST_VIEWS);
  const seen = ({ view, pose }) =>
    points.filter((point) => {
      const offset = sub(point, pose.eye);
      if (!isInPicture(view, pose, offset)) return false;
      const distance = Math.hypot(...offset);
      const hit = hitDistance(splats, pose.eye, scale(offset, 1 / distance));
      // A point inside of the object or on its back is hidden by the object alone.
      return hit === null || hit > distance - 2 * radius;
    }).length;
  let best = null;
  for (const one of near) {
    const count = seen(one);
    if (count > 0 && (!best || count > best.count)) best = { view: one.view, count };
  }
  return best?.view ?? null;
}

/** Return the view that is most like a camera: near by, as a share of `radius`, and looking the same way. */
export function mostLike({ eye, forward }, radius, views, poseOf) {
  const distance = (view) => {
    const pose = poseOf(view.world_to_camera);
    return Math.hypot(...sub(pose.eye, eye)) / radius + 1 - dot(pose.forward, forward);
  };
  return views.reduce((best, view) => (best && distance(best) <= distance(view) ? best : view), null);
}
