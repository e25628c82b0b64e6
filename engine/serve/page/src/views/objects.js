// Isolation of objects by words, clicks or all at once, and the list of objects.
import { setLearning, startJob } from "../api.js";
import { announce, confirmed, during, field, h, notify, put, refill, setText, show } from "../dom.js";
import { createObjectCard } from "./object_card.js";
import { megabytes } from "../format.js";
import { isActive } from "../jobs.js";
import { createProgress } from "./progress.js";
import { said, t } from "../language.js";

export function createObjects(context, { stage, clicks }) {
  const { id } = context;
  const cards = new Map(); // id of the object -> its card
  let names = null; // of the last update, to tell what is new
  let lastDone = null; // id of the last isolation that ended, "" before one

  const words = h("input", { type: "text", placeholder: "vase, teapot", autocomplete: "off", maxlength: 500, required: true, enterkeyhint: "go" });
  const isolate = h("button", { class: "main" }, t("Isolate"));
  const findAll = action(t("Find all"), () => run({ find_all: true }));
  const click = action(t("Click an object"), async () => clicks.open({ photo: stage.photo() }));
  const rest = action(t("Background"), () => run({ background: true }));
  rest.title = t("Everything that is in no object becomes an object of its own");
  const details = action(t("Add detail to all"), () => run({ detail: true }));
  details.title = t("Train every object on the photos at their own resolution; the scene stays as it is");
  const form = h(
    "form",
    { class: "prompt", onsubmit: (event) => (event.preventDefault(), during(isolate, isolateWords)) },
    h("div", { class: "row bottom" }, field(t("Which object?"), words), isolate),
    h("p", { class: "hint" }, t("In English, many things also in German or French. Separate several objects by commas.")),
  );
  const progress = createProgress(context, { compact: true });
  const told = h("p", { class: "quiet", hidden: true });
  const refused = h("div", { class: "not-found", hidden: true });
  const none = h("p", { class: "quiet" }, t("No objects yet. Type a word, press Find all, or click an object in a photo."));
  const list = h("ul", { class: "objects", "aria-label": t("Objects") });
  const dim = h("input", { type: "checkbox", onchange: () => stage.looks.setDim(dim.checked).catch((error) => notify(error.message)) });
  const dimming = h("label", { class: "check", hidden: true }, dim, t("Dim what is not lit"));
  const learn = h("input", { type: "checkbox", onchange: () => learnWords() });
  const learning = h("label", { class: "check" }, learn, t("Learn my words"));
  learning.title = t("Objects that you name, click or accept teach their words, which this and your other learning projects then find");
  const element = h(
    "div",
    { class: "card panel" },
    h("h2", null, t("Objects")),
    form,
    h("div", { class: "row" }, click, findAll, rest, details),
    learning,
    progress.element,
    told,
    refused,
    none,
    dimming,
    list,
  );

  // A field of one line drops the line breaks of a pasted list.
  words.addEventListener("paste", (event) => {
    const text = event.clipboardData.getData("text").trim();
    if (!/[\r\n]/.test(text)) return;
    event.preventDefault();
    words.setRangeText(text.replace(/\s*[\r\n]+\s*/g, "; "), words.selectionStart, words.selectionEnd, "end");
  });

  function action(text, run) {
    const button = h("button", { type: "button", onclick: () => during(button, run) }, text);
    return button;
  }

  async function run(job) {
    await startJob(id, { kind: "segment", ...job });
    await context.refresh();
  }

  async function learnWords() {
    try {
      await setLearning(id, learn.checked);
    } catch (error) {
      learn.checked = !learn.checked;
      notify(error.message);
    }
  }

  async function isolateWords() {
    await run({ prompt: words.value.trim() });
    words.value = "";
  }

  function update(project) {
    const isElsewhere = Boolean(project.job) && project.job.kind !== "segment";
    const isToldBelow = project.not_found && !isActive(project.job);
    progress.update(isElsewhere || isToldBelow ? null : project.job, isElsewhere ? [] : project.waiting);
    // What was found again adds no card to the list.
    const isDone = project.job?.kind === "segment" && project.job.state === "finished";
    setText(told, isDone ? said(project.job.message) : "");
    show(told, isDone && Boolean(told.textContent));
    updateRefused(isActive(project.job) ? null : project.not_found, project.objects);
    show(none, project.objects.length === 0);
    learn.checked = project.learns;
    const present = new Set(project.objects.map((object) => object.id));
    for (const [key, card] of cards) {
      if (present.has(key)) continue;
      if (card.isAlone()) stage.showScene();
      card.element.remove();
      cards.delete(key);
      stage.looks.forget(key, true);
    }
    for (const object of project.objects) {
      if (!cards.has(object.id)) {
        const card = createObjectCard(context, object, { stage, clicks, shownAlone });
        cards.set(object.id, card);
        put(list, card.element);
      }
      cards.get(object.id).update(object);
    }
    const fresh = project.objects.filter((object) => names && !names.has(object.id));
    show(dimming, project.objects.length > 0);
    lightResult(project, isDone);
    lastDone ??= "";
    if (fresh.length > 0) announce(t("New: {}.", fresh.map((object) => object.name).join(", ")));
    names = present;
  }

  /** Light what an isolation made or found again, so that it is seen at once. */
  function lightResult({ job, objects }, isDone) {
    if (!isDone || job.id === lastDone) return;
    const isNews = lastDone !== null;
    lastDone = job.id;
    const object = objects.find((one) => one.id === job.objects[0] && one.kind !== "background");
    // What is shown alone is shown anew by its card: in the scene, detail is not seen.
    if (!isNews || !object || cards.get(object.id).isAlone()) return;
    stage.point(object).catch((error) => notify(error.message));
  }

  /** Mark the object that is shown alone; null for the whole scene. */
  function shownAlone(object) {
    for (const [key, card] of cards) card.setAlone(key === object);
  }

  function updateRefused(answer, known) {
    const alike = known.filter((object) => answer?.objects.includes(object.id));
    const key = JSON.stringify([answer ?? null, alike.map((object) => object.name)]);
    if (refused.key === key) return;
    refused.key = key;
    show(refused, Boolean(answer));
    if (!answer) return refill(refused);
    const candidates = answer.candidates ?? [];
    const suggested = answer.suggestions.map((text) => action(text, () => run({ prompt: text })));
    const texts = new Set(candidates.map((one) => one.text));
    const named = texts.size === 1 ? t("Is it one of these? It is then called {}.", [...texts][0]) : t("Is it one of these?");
    const existing = alike.map((object) => action(object.name, () => stage.point(object, true)));
    refill(
      refused,
      h("h3", null, t("Not found")),
      ...answer.messages.map((text) => h("p", null, said(text))),
      suggested.length > 0 ? h("div", { class: "row", role: "group", "aria-label": t("Words to try") }, h("span", null, t("Try:")), suggested) : null,
      existing.length > 0 ? h("div", { class: "row", role: "group", "aria-label": t("Objects that exist") }, h("span", null, t("Exists:")), existing) : null,
      answer.offer ? offered(answer.offer) : null,
      candidates.length > 0 ? h("p", null, named) : null,
      h("ul", { class: "candidates" }, candidates.map((one) => candidateItem(one, known, texts.size > 1))),
      action(t(candidates.length > 0 ? "None of these: click it" : "Click it in a photo"), async () => clicks.open({ photo: candidates[0]?.photo ?? stage.photo() })),
    );
    announce([t("Not found"), ...answer.messages.map(said)].join(". "));
  }

  /** A model that knows more words: to be fetched, stored since the words were refused, or the server's owner fetches it. */
  function offered(offer) {
    if (offer.refusal) return h("p", null, said(offer.refusal));
    if (offer.stored) return action(t("Ask again, with the model that knows any word"), () => run({ any_word: true }));
    return action(t("Know any word ({})", megabytes(offer.bytes)), () => knowAnyWord(offer));
  }

  /** Fetch a model that knows more words, once for all projects, and ask for the refused words again. */
  async function knowAnyWord(offer) {
    const told = t(
      "{}, {}. It is fetched once for all projects; then describing a scene takes about a minute, once. It was not tested with its real weights yet. Licence: {}. Who may use it: {}.",
      ...[offer.model, megabytes(offer.bytes), offer.licence, offer.users],
    );
    if (await confirmed(t("Fetch a model that knows any word?"), told, t("Fetch and ask again"), "main")) await run({ any_word: true });
  }

  /** A candidate that is an object already is lit and not stored again. Its text is shown where there are several. */
  function candidateItem(candidate, known, several) {
    const same = known.find((object) => object.id === candidate.object);
    const caption = same ? t("{} (exists)", same.name) : several ? candidate.text : "";
    const choose = () => (same ? stage.point(same, true) : run({ accept: candidate.number }));
    const button = h(
      "button",
      { type: "button", "aria-label": caption || candidate.text, onclick: () => during(button, choose) },
      h("img", { src: candidate.picture, alt: "" }),
      caption ? h("span", null, caption) : null,
    );
    return h("li", null, button);
  }

  /** Objects were hidden, lit or dimmed. */
  function looksChanged() {
    for (const card of cards.values()) card.updateLooks();
    dim.checked = stage.looks.isDim();
  }

  return { element, update, shownAlone, looksChanged };
}
