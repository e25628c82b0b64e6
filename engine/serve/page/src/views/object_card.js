// One object: show it, correct it, fill in its record, download it, delete it.
import { changeObject, deleteObject, exportUrl, objectUrl, startJob } from "../api.js";
import { announce, confirmed, during, field, h, notify, refill, setText } from "../dom.js";
import { createObjectButtons } from "../object_buttons.js";
import { plural, t } from "../language.js";

const FIELDS = ["name", "title", "catalogue_number", "rights", "notes"];

export function createObjectCard(context, first, { stage, clicks, shownAlone }) {
  const { id, session } = context;
  const { looks } = stage;
  let object = first;
  let alone = false;
  let version = Date.now(); // in the address, so that a corrected object is loaded again

  const name = h("span", { class: "object-name" });
  const facts = h("span", { class: "quiet" });
  const picture = h("span", { class: "thumbnail" });
  const buttons = createObjectButtons(looks, () => object, (one) => stage.point(one, true), [picture, h("span", null, name, facts)]);
  const look = h("button", { type: "button", "aria-pressed": "false", onclick: () => during(look, toggle) }, t("Show alone"));
  const correct = h("button", { type: "button", onclick: () => during(correct, async () => clicks.open({ object, photo: stage.photo() })) }, t("Correct"));
  const detail = h("button", { type: "button", onclick: () => during(detail, addDetail) }, t("Add detail"));
  detail.title = t("Train the object on the photos at their own resolution; the scene stays as it is");
  const download = ({ name: format, label }) => h("li", null, h("a", { class: "button", href: exportUrl(id, object.id, format), download: "" }, t(label)));
  const downloads = h("details", { class: "downloads" }, h("summary", null, t("Download")), h("ul", { class: "row" }, session.formats.map(download)));
  const inputs = Object.fromEntries(
    FIELDS.map((key) => {
      const props = { maxlength: key === "notes" ? 5000 : 300, autocomplete: "off", value: object[key] ?? "" };
      const input = key === "notes" ? h("textarea", { rows: 3, ...props }) : h("input", { type: "text", required: key === "name", ...props });
      return [key, { input, row: field(fieldText(key), input) }];
    }),
  );
  const save = h("button", { class: "main" }, t("Save"));
  const remove = h("button", { type: "button", class: "danger-text", onclick: () => during(remove, removeThis) }, t("Delete object"));
  const form = h(
    "form",
    { onsubmit: (event) => (event.preventDefault(), during(save, saveRecord)) },
    Object.values(inputs).map(({ row }) => row),
    h("div", { class: "row apart" }, save, remove),
  );
  const details = h("details", { class: "record" }, h("summary", null, t("Name and record")), form);
  const element = h(
    "li",
    { class: "object" },
    buttons.element,
    h("div", { class: "row" }, look, correct, detail),
    downloads,
    details,
  );

  async function toggle() {
    if (alone) return stage.showScene();
    await showThis();
    shownAlone(object.id);
  }

  function showThis() {
    return stage.showObject(`${objectUrl(id, object.id)}&v=${version}`, object.name);
  }

  async function addDetail() {
    await startJob(id, { kind: "segment", object: object.id, detail: true });
    await context.refresh();
  }

  async function saveRecord() {
    const values = {};
    for (const key of FIELDS) {
      const value = inputs[key].input.value.trim();
      if (value !== (object[key] ?? "")) values[key] = value;
    }
    if (Object.keys(values).length > 0) await changeObject(id, object.id, values);
    details.open = false;
    details.firstChild.focus();
    announce(t("The record is saved."));
    await context.refresh();
  }

  async function removeThis() {
    const sure = await confirmed(t("Delete “{}”?", object.name), t("The object is moved to the server's trash. The scene stays as it is."), t("Delete object"));
    if (!sure) return;
    await deleteObject(id, object.id);
    await context.refresh();
  }

  function setAlone(value) {
    alone = value;
    look.setAttribute("aria-pressed", String(value));
    setText(look, value ? t("Show in the scene") : t("Show alone"));
    element.classList.toggle("current", value);
  }

  function updateLooks() {
    buttons.update();
    element.classList.toggle("lit", looks.lit() === object.id);
    element.classList.toggle("unseen", looks.isHidden(object.id));
  }

  function updatePicture() {
    const missing = () => refill(picture, h("span", { "aria-hidden": "true" }, "◌"));
    refill(picture, h("img", { src: `${object.picture}?v=${version}`, alt: "", loading: "lazy", onerror: missing }));
  }

  function update(news) {
    const isNew = news.state !== object.state;
    if (isNew) version = Date.now();
    const before = object;
    object = news;
    if (isNew) looks.forget(object.id, false);
    if (isNew && alone) showThis().catch((error) => notify(error.message));
    if (isNew || !picture.firstChild) updatePicture();
    setText(name, object.title || object.name);
    setText(facts, factsOf(object));
    for (const key of FIELDS) {
      const { input } = inputs[key];
      // What a person is typing is not overwritten.
      if (input.value.trim() === (before[key] ?? "")) input.value = object[key] ?? "";
    }
    updateLooks();
  }

  update(first);
  return { element, update, updateLooks, setAlone, isAlone: () => alone };
}

function fieldText(key) {
  const texts = {
    name: t("Name"),
    title: t("Title in the catalogue"),
    catalogue_number: t("Catalogue number"),
    rights: t("Rights"),
    notes: t("Notes"),
  };
  return texts[key];
}

function factsOf(object) {
  const parts = [object.title ? object.name : "", object.catalogue_number, plural(object.n_gaussians, "{} Gaussian", "{} Gaussians")];
  if (object.has_detail) parts.push(t("with detail"));
  if (object.kind !== "text") parts.push(object.prompt);
  else if (object.prompt !== object.name) parts.push(t("found as “{}”", object.prompt));
  return parts.filter(Boolean).join(" · ");
}
