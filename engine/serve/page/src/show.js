// A page of its own that shows one scene or object, with its record: everything that it needs is inside of the file.
import { announce, h, notify, put, refill, setText, show } from "./dom.js";
import { createObjectButtons } from "./object_buttons.js";
import { createObjectLooks } from "./object_looks.js";
import { createTools, helpText } from "./tools.js";
import { fittingLanguage, speak, t } from "./language.js";

const data = JSON.parse(document.getElementById("data").textContent);
const language = fittingLanguage(Object.keys(data.languages));
speak(language, data.languages[language]);
// What the page has from its start is English.
for (const element of document.querySelectorAll("header p, h2, dt, dd.unit, th, summary")) setText(element, t(element.textContent));
const canvas = h("canvas", { tabindex: 0, role: "application", "aria-label": t("{} in 3D. {}", data.title, helpText()) });
const loading = h("p", { class: "loading", role: "status" }, t("Loading…"));
let viewer = null;
let view = null; // that was looked through last, null after a movement
const tools = createTools(canvas, {
  viewer: () => viewer,
  views: () => data.views,
  lookFrom,
  current: () => view,
  home: () => lookFrom(data.views[0]),
  unit: () => ({ metresPerUnit: data.metresPerUnit, text: data.unit }),
  file: () => data.file,
  frame: () => frame,
});
const box = h("div", { class: "canvas-box" }, canvas, tools.parts, loading);
const frame = h("div", { class: "frame" }, box, tools.element);
const list = objectList();
refill(document.getElementById("stage"), frame, h("p", { class: "hint" }, helpText()), list.element);
// The messages of dom.js have their places in the page of the server; here they are made.
put(
  document.body,
  h("div", { id: "notices", class: "notices", role: "region", "aria-label": t("Messages") }),
);

try {
  const module = URL.createObjectURL(new Blob([await unpacked("viewer")], { type: "text/javascript" }));
  const { createViewer } = await import(module);
  viewer = await createViewer(canvas, { t, moved, wheelIgnored: tools.wheelIgnored });
  viewer.setScene(data.center, data.radius, data.up);
  lookFrom(data.views[0]);
  const url = URL.createObjectURL(await unpacked("splats"));
  await viewer.load(url, (share) => setText(loading, t("Loading… {} %", Math.round(100 * share))));
  URL.revokeObjectURL(url);
  show(loading, false);
  box.dataset.ready = "true";
  tools.listen();
} catch (error) {
  setText(loading, error.message);
}

/** Return what a script element of the page holds, gzip in Base64, as a Blob. */
async function unpacked(id) {
  const element = document.getElementById(id);
  const blob = await unpackedText(element.textContent);
  element.remove();
  return blob;
}

async function unpackedText(text) {
  const response = await fetch(`data:application/gzip;base64,${text.trim()}`);
  return new Response(response.body.pipeThrough(new DecompressionStream("gzip"))).blob();
}

function lookFrom(next) {
  viewer.lookThrough(next);
  view = next;
}

function moved(isPhoto) {
  if (!isPhoto) view = null;
  tools.moved();
}

/** The objects of a scene: light one and look at it, hide it, dim the rest. The page of an object has none. */
function objectList() {
  const objects = data.objects ?? [];
  const read = async (id) => {
    const packed = await unpackedText(objects.find((object) => object.id === id).members);
    return { count: data.count, bits: new Uint8Array(await packed.arrayBuffer()) };
  };
  const rows = [];
  const looks = createObjectLooks(() => viewer, read, () => rows.forEach((row) => row.update()));
  const point = async (object) => {
    if (!viewer) return;
    box.scrollIntoView({ block: "nearest" });
    await looks.light(object.id);
    view = viewer.lookAt(await looks.members(object.id), data.views);
    announce(t("{} is lit in the scene.", object.name));
  };
  rows.push(...objects.map((object) => createObjectButtons(looks, () => object, point, object.name)));
  rows.forEach((row) => row.update());
  const dim = h("input", { type: "checkbox", onchange: () => looks.setDim(dim.checked).catch((error) => notify(error.message)) });
  const element = h(
    "section",
    { class: "parts", hidden: objects.length === 0, "aria-label": t("Objects") },
    h("h2", null, t("Objects")),
    h("label", { class: "check" }, dim, t("Dim what is not lit")),
    h("ul", null, rows.map((row) => h("li", null, row.element))),
  );
  return { element };
}
