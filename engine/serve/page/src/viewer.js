// Shows Gaussian splats with PlayCanvas. The only file that knows the renderer; it is bundled as viewer.js.
import {
  AppBase,
  AppOptions,
  Asset,
  CameraComponentSystem,
  Color,
  Entity,
  GAMMA_SRGB,
  GSplatComponentSystem,
  GSplatHandler,
  Mat4,
  Quat,
  SHADERLANGUAGE_GLSL,
  ShaderChunks,
  TONEMAP_NONE,
  WORKBUFFER_UPDATE_ONCE,
  createGraphicsDevice,
} from "playcanvas";
import { withLooks } from "./looks.js";
import { createOrbit, poseOf } from "./orbit.js";
import { hitDistance, mostLike, nearestTo, rayThrough, viewOfObject, viewsOf } from "./pick.js";
import { add, dot, scale, sub } from "./vectors.js";

const FOV = (50 * Math.PI) / 180; // Of the shorter side, when no photo gives the lens.
const SLOW_FRAME = 50; // Milliseconds. Slower pictures are drawn with fewer pixels while the camera moves.
const SAMPLES = 12; // Gaussians of an object for which it is asked whether a photo shows them.
const REST = 250; // Milliseconds without movement until the sharp picture is drawn.
const DRAWN_MS = 3000; // Milliseconds after which a hidden page, which draws nothing, is not waited for.
const LONGEST_MS = 20_000; // The same for a page that is seen: slow computers need seconds for some pictures.

/**
 * Return a viewer that draws into `canvas`: {load(url, progress), showOnly(url|null), setLooks(looks), lookThrough(view),
 * setScene(...), frame(center, radius, up), frameAlone(views), zoom(factor), pick(x, y), place(point),
 * viewsThatShow(point, views), lookAt(members, views), nearestView(views), picture(), dispose()}. `moved(isPhoto)` of the
 * options is called when the camera moves, `wheelIgnored()` when a wheel turned that scrolls the page.
 */
export async function createViewer(canvas, { t, moved = () => {}, wheelIgnored = () => {} }) {
  const app = await createApp(canvas, t);
  const device = app.graphicsDevice;
  const camera = new Entity("camera");
  camera.addComponent("camera", {
    clearColor: new Color(0, 0, 0, 1), // The scene was trained on black.
    toneMapping: TONEMAP_NONE,
    gammaCorrection: GAMMA_SRGB, // The colours of the file are sRGB values already.
  });
  camera.camera.calculateProjection = (matrix) => matrix.set(projection());
  app.root.addChild(camera);

  let scene = null; // {asset, entity} of the whole scene
  let single = null; // the same of the object that is shown alone
  let looks = null; // of the scene's Gaussians, in the order of the file: see looks.js
  let wanted = 0; // counts showOnly and load, so that only the last one takes effect
  let size = { center: [0, 0, 0], radius: 1 };
  let lens = null; // the photo's camera, whose lens is used, or null
  let pose = poseOf([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 1, 0, 0, 0, 1]);
  let resolution = 1;
  let frameTime = 0;
  let restTimer = 0;
  let saved = 0; // pictures that are being saved, which stay sharp
  let requested = 0;
  let lastFrame = 0;

  const orbit = createOrbit(
    canvas,
    (newPose) => {
      // Only the photo's own camera has its principal point off the centre.
      if (lens?.exact) lens = { ...lens, exact: false };
      moveTo(newPose);
      moved(false);
    },
    () => intrinsics(canvas.clientWidth, canvas.clientHeight).f[0],
    wheelIgnored,
  );
  const resizing = new ResizeObserver(() => resize());
  resizing.observe(canvas);
  app.systems.gsplat.on("frame:request", draw);
  app.systems.gsplat.on("frame:ready", (_camera, _layer, ready) => ready || drawNext());
  app.start();
  resize();

  /** Focal lengths and principal point for a picture of w x h, such that the whole photo is seen. */
  function intrinsics(w, h) {
    if (!lens) {
      const f = Math.min(w, h) / (2 * Math.tan(FOV / 2));
      return { f: [f, f], c: [w / 2, h / 2] };
    }
    const s = Math.min(w / lens.width, h / lens.height);
    const c = lens.exact ? [w / 2 + (lens.cx - lens.width / 2) * s, h / 2 + (lens.cy - lens.height / 2) * s] : [w / 2, h / 2];
    return { f: [lens.fx * s, lens.fy * s], c };
  }

  /** The projection matrix of WebGL, column-major. */
  function projection() {
    const w = Math.max(canvas.clientWidth, 1);
    const h = Math.max(canvas.clientHeight, 1);
    const { f, c } = intrinsics(w, h);
    const near = 0.01 * size.radius;
    const far = 1000 * size.radius;
    const depth = [-(far + near) / (far - near), (-2 * far * near) / (far - near)];
    return [
      ...[(2 * f[0]) / w, 0, 0, 0],
      ...[0, (2 * f[1]) / h, 0, 0],
      ...[1 - (2 * c[0]) / w, (2 * c[1]) / h - 1, depth[0], -1],
      ...[0, 0, depth[1], 0],
    ];
  }

  function moveTo(newPose) {
    pose = newPose;
    const { eye, right, down, forward } = pose;
    // WebGL cameras have y up and look along -z.
    const matrix = new Mat4();
    matrix.set([...right, 0, ...scale(down, -1), 0, ...scale(forward, -1), 0, ...eye, 1]);
    camera.setPosition(...eye);
    camera.setRotation(new Quat().setFromMat4(matrix));
    if (frameTime > SLOW_FRAME && saved === 0) coarseUntilRest();
    draw();
  }

  function coarseUntilRest() {
    clearTimeout(restTimer);
    restTimer = setTimeout(() => setResolution(1), REST);
    setResolution(0.5);
  }

  function setResolution(value) {
    if (resolution === value) return;
    resolution = value;
    resize();
  }

  function resize() {
    const ratio = Math.min(window.devicePixelRatio, 2) * resolution;
    const w = Math.max(1, Math.round(canvas.clientWidth * ratio));
    const h = Math.max(1, Math.round(canvas.clientHeight * ratio));
    if (canvas.width !== w || canvas.height !== h) device.setResolution(w, h);
    draw();
  }

  function draw() {
    if (!app.renderNextFrame) requested = performance.now();
    app.renderNextFrame = true;
  }

  /** Ask for a picture after the present one; `draw` is without effect while a picture is drawn. */
  function drawNext() {
    app.once("frameend", draw);
  }

  // How fast this computer draws: the time from the request, or from the picture before, to the picture.
  app.on("frameend", () => {
    const now = performance.now();
    if (resolution === 1) frameTime = 0.7 * frameTime + 0.3 * (now - Math.max(requested, lastFrame));
    lastFrame = now;
  });

  async function addSplats(url, progress) {
    const { asset, order } = await fetchSplats(app, url, progress, t);
    const entity = new Entity("splats");
    entity.addComponent("gsplat", { asset });
    return { asset, entity, order };
  }

  /** The scene's Gaussians as they are shown: some may be hidden, lit or dimmed. */
  function shownData() {
    return withLooks(scene.asset.resource.gsplatData, looks, scene.order);
  }

  /** Hide, light or dim Gaussians of the scene: one number of looks.js for each, in the order of the file, or null. */
  async function setLooks(newLooks) {
    if (scene && newLooks && newLooks.length !== scene.order.length) {
      throw new Error(t("The objects do not belong to the scene that is shown. Load the page again."));
    }
    looks = newLooks;
    if (!scene) return;
    scene.asset.resource.updateColorData(shownData());
    scene.entity.gsplat.workBufferUpdate = WORKBUFFER_UPDATE_ONCE;
    await drawn(2);
  }

  function remove(splats) {
    if (!splats) return;
    splats.entity.destroy();
    app.assets.remove(splats.asset);
    splats.asset.unload();
    draw();
  }

  /** Fetch a scene and show it in place of the one before. `progress(share)` is called meanwhile. */
  async function load(url, progress = () => {}) {
    const turn = ++wanted;
    const loaded = await addSplats(url, progress);
    if (turn !== wanted) return remove(loaded);
    remove(scene);
    remove(single);
    single = null;
    scene = loaded;
    looks = null;
    app.root.addChild(scene.entity);
    await drawn(1);
  }

  /** Show an object alone, or the scene again with null. */
  async function showOnly(url) {
    const turn = ++wanted;
    const loaded = url ? await addSplats(url, () => {}) : null;
    if (turn !== wanted) return remove(loaded);
    remove(single);
    single = loaded;
    if (single) app.root.addChild(single.entity);
    if (scene) scene.entity.enabled = !single;
    await drawn(1);
  }

  /**
   * Resolve when `least` pictures show the present splats, sorted by depth: to what `read()` returns, which is called while
   * the last of them can be read.
   */
  function drawn(least, read = () => {}) {
    return new Promise((resolve) => {
      const begun = performance.now();
      let frames = 0;
      let timer = 0;
      const end = () => {
        app.systems.gsplat.off("frame:ready", onReady);
        clearTimeout(timer);
        resolve(read());
      };
      const onReady = (_camera, _layer, ready, loading) => {
        frames += 1;
        if (ready && loading === 0 && frames >= least) app.once("frameend", end);
        else drawNext();
      };
      const giveUp = () => {
        if (document.hidden) return end();
        if (performance.now() - begun > LONGEST_MS) app.once("frameend", end);
        timer = setTimeout(giveUp, DRAWN_MS);
        draw();
      };
      timer = setTimeout(giveUp, DRAWN_MS);
      app.systems.gsplat.on("frame:ready", onReady);
      draw();
    });
  }

  /** Set the vertical, centre and size of the scene, which movements depend on. */
  function setScene(center, radius, up) {
    size = { center, radius };
    orbit.setScene(up, radius);
  }

  /** Look from exactly where a photo was taken; further movements turn around what is as far as `near`. */
  function lookThrough(view, near = size.center) {
    lens = { ...view, exact: true };
    const at = poseOf(view.world_to_camera);
    orbit.from(at, near);
    moveTo(at);
    moved(true);
  }

  /** Look at a sphere from the present direction. */
  function frameSphere(center, radius) {
    const { f } = intrinsics(canvas.clientWidth, canvas.clientHeight);
    const shorter = Math.min(canvas.clientWidth / f[0], canvas.clientHeight / f[1]);
    orbit.frameSphere(center, radius, Math.atan(shorter / 2));
  }

  /** Look at the scene from outside. */
  function frame(center, radius, up) {
    setScene(center, radius, up);
    frameSphere(center, radius);
  }

  /** Look at the object that is shown alone, from the side of the photo that shows it largest. */
  function frameAlone(views) {
    if (!single) return;
    const { center, radius } = sphereOf(single.asset.resource.centers);
    const best = nearestTo(center, views, poseOf);
    if (best) orbit.from(poseOf(best.world_to_camera), center);
    frameSphere(center, radius);
  }

  /**
   * Look from the place of the photo that shows an object best; `members` has a byte for each Gaussian, in the order of
   * the file. Return that view, or null where no photo shows it.
   */
  function lookAt(members, views) {
    const { centers } = scene.asset.resource;
    const places = [...scene.order.keys()].filter((place) => members[scene.order[place]]);
    if (places.length === 0) return null;
    const points = places.map((place) => [...centers.subarray(3 * place, 3 * place + 3)]);
    const { center, radius } = sphereOf(points.flat());
    // Neighbours in memory are neighbours in space, so every n-th is a fair sample.
    const step = Math.max(1, Math.floor(points.length / SAMPLES));
    const sample = points.filter((_, i) => i % step === 0);
    const best = viewOfObject(sample, { center, radius }, views, poseOf, shownData());
    if (best) lookThrough(best, center);
    return best;
  }

  /** Return the view whose place and direction are most like those of the present camera. */
  function nearestView(views) {
    return mostLike(pose, size.radius, views, poseOf);
  }

  /** Return the point of the scene that is seen at a place of the canvas, in CSS pixels, or null where there is nothing. */
  function pick(x, y) {
    if (!scene) return null;
    const { f, c } = intrinsics(canvas.clientWidth, canvas.clientHeight);
    const { eye, direction } = rayThrough(pose, f, c, [x, y]);
    const distance = hitDistance(single ? single.asset.resource.gsplatData : shownData(), eye, direction);
    return distance === null ? null : add(eye, scale(direction, distance));
  }

  /** Return where the canvas shows a point of the scene, in CSS pixels, or null when it is behind the camera. */
  function place(point) {
    const { f, c } = intrinsics(canvas.clientWidth, canvas.clientHeight);
    const offset = sub(point, pose.eye);
    const depth = dot(offset, pose.forward);
    return depth > 0 ? [c[0] + (f[0] * dot(offset, pose.right)) / depth, c[1] + (f[1] * dot(offset, pose.down)) / depth] : null;
  }

  /** Return those of `views` whose photos show `point`, the one that looks most like the present camera first. */
  function viewsThatShow(point, views) {
    return viewsOf(point, pose.eye, views, poseOf, shownData());
  }

  /** Return the picture as a PNG. */
  async function picture() {
    clearTimeout(restTimer);
    saved += 1;
    try {
      setResolution(1);
      // The first ones may still have the order of the camera before. WebGL forgets a picture after its frame.
      return await drawn(4, () => new Promise((resolve) => canvas.toBlob(resolve, "image/png")));
    } finally {
      saved -= 1;
    }
  }

  function dispose() {
    clearTimeout(restTimer);
    resizing.disconnect();
    orbit.dispose();
    app.destroy();
  }

  return {
    load, showOnly, setLooks, lookThrough, setScene, frame, frameAlone, zoom: orbit.zoom, pick, place, viewsThatShow, lookAt,
    nearestView, picture, dispose,
  };
}

async function createApp(canvas, t) {
  let device;
  try {
    device = await createGraphicsDevice(canvas, { deviceTypes: ["webgl2"], antialias: false, alpha: false, depth: false });
  } catch {
    throw new Error(t("This browser cannot show 3D, because WebGL 2 is missing or switched off. The photos and downloads still work."));
  }
  const options = new AppOptions();
  options.graphicsDevice = device;
  options.componentSystems = [CameraComponentSystem, GSplatComponentSystem];
  options.resourceHandlers = [GSplatHandler];
  const app = new AppBase(canvas);
  app.init(options);
  app.autoRender = false; // A picture is drawn only when something changed.
  matchTraining(app);
  return app;
}

/** Draw as the engine's training did: no anti-aliasing factor, no size limit, the Gaussian's own fall-off to 1/255. */
function matchTraining(app) {
  const settings = app.scene.gsplat;
  settings.antiAlias = false; // Low pass of 0.3 pixels^2 without change of opacity.
  settings.minPixelSize = 0;
  settings.useTonemap = false;
  settings.useFog = false;
  settings.alphaClipForward = 1 / 255;
  settings.colorUpdateAngle = 2; // Degrees until colours that depend on the direction are computed anew.
  // The renderer cuts each Gaussian at sqrt(8) standard deviations and lowers it to zero there. The engine goes on to
  // an opacity of 1/255, which is sqrt(ln(255)) / 2 = 1.177 of that radius. Without these changes, objects get too dark.
  const chunks = ShaderChunks.get(app.graphicsDevice, SHADERLANGUAGE_GLSL);
  change(chunks, "gsplatCommonVS", "min(1.0, sqrt(", "min(1.2, sqrt(");
  change(chunks, "gsplatPS", "if (A > 1.0)", "if (A > 1.44)");
  change(chunks, "gsplatPS", "normExp(A) *", "exp(A * -4.0) *");
}

function change(chunks, name, from, to) {
  const code = chunks.get(name);
  // Fails in the tests of a new version of the renderer, before anybody sees a wrong picture.
  if (!code.includes(from)) throw new Error(`The renderer's shader ${name} has changed.`);
  chunks.set(name, code.replace(from, to));
}

async function fetchSplats(app, url, progress, t) {
  const response = await fetch(url, { credentials: "same-origin", cache: "no-cache" }).catch(() => null);
  if (!response?.ok) throw new Error(t("The 3D data could not be loaded. Check the connection and load the page again."));
  const asset = new Asset(url, "gsplat", { url, filename: "scene.ply", contents: response }, { reorder: false });
  app.assets.add(asset);
  // Neighbours lie together in memory, as the renderer would order them by itself; `order` leads back to the file.
  let order = null;
  asset.on("load:data", (data) => {
    order = data.calcMortonOrder();
    data.reorder(order);
  });
  asset.on("progress", (received, total) => total > 0 && progress(received / total));
  return new Promise((resolve, reject) => {
    asset.once("load", () => resolve({ asset, order }));
    asset.once("error", () => reject(new Error(t("The 3D data is damaged. Load the page again."))));
    app.assets.load(asset);
  });
}

/** Return a sphere around most of the points; a few far ones do not count. */
function sphereOf(points) {
  const count = points.length / 3;
  const middle = (values, share) => values[Math.min(values.length - 1, Math.floor(share * values.length))];
  const center = [0, 0, 0];
  for (let axis = 0; axis < 3; axis += 1) {
    const values = Float32Array.from({ length: count }, (_, i) => points[3 * i + axis]).sort();
    center[axis] = (middle(values, 0.02) + middle(values, 0.98)) / 2;
  }
  const distances = Float32Array.from({ length: count }, (_, i) =>
    Math.hypot(points[3 * i] - center[0], points[3 * i + 1] - center[1], points[3 * i + 2] - center[2]),
  ).sort();
  return { center, radius: Math.max(middle(distances, 0.97), 1e-6) };
}
