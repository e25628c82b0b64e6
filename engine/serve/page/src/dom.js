// Small helpers for the DOM. Text from the server always becomes a text node, never HTML.
import { t } from "./language.js";

const SVG = "http://www.w3.org/2000/svg";

/** Return a new element: h("button", {class: "main", onclick: save}, "Save"). False and null children are left out. */
export function h(tag, props, ...children) {
  return fill(document.createElement(tag), props, children);
}

/** Like `h`, for SVG. */
export function svg(tag, props, ...children) {
  return fill(document.createElementNS(SVG, tag), props, children);
}

function fill(element, props, children) {
  for (const [name, value] of Object.entries(props ?? {})) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "value") element.value = value;
    else element.setAttribute(name, value === true ? "" : value);
  }
  put(element, ...children);
  return element;
}

/**
 * Append children to an element; lists of children may be nested. `Element.append` writes "[object ...]" for a list, so
 * nothing else appends in this page.
 */
export function put(element, ...children) {
  element.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false));
}

/** Put children in the place of those that an element has. */
export function refill(element, ...children) {
  element.replaceChildren();
  put(element, ...children);
}

/** Show or hide an element. */
export function show(element, visible) {
  element.hidden = !visible;
}

/** Change the text only if it differs, so that screen readers do not repeat it. */
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

let lastId = 0;
/** Return an id that is unique in the page. */
export function newId(prefix) {
  lastId += 1;
  return `${prefix}-${lastId}`;
}

/** Return a label and its input as one block. */
export function field(label, input, hint) {
  input.id ||= newId("field");
  const note = hint ? h("span", { class: "hint", id: `${input.id}-hint` }, hint) : null;
  if (note) input.setAttribute("aria-describedby", note.id);
  return h("div", { class: "field" }, h("label", { for: input.id }, label), input, note);
}

/** Say something to screen readers without moving the focus. */
export function announce(text) {
  document.getElementById("announcements").textContent = text;
}

/** Show a problem at the bottom of the page until it is closed. */
export function notify(text) {
  const notices = document.getElementById("notices");
  if ([...notices.children].some((notice) => notice.firstChild.textContent === text)) return;
  const notice = h("div", { class: "notice", role: "alert" }, h("p", null, text));
  put(notice, h("button", { type: "button", class: "plain", onclick: () => notice.remove() }, t("Close")));
  put(notices, notice);
}

/** Run an async action of a button: it cannot be pressed twice, and a problem is shown as a sentence. */
export async function during(button, action) {
  if (button.getAttribute("aria-disabled") === "true") return;
  button.setAttribute("aria-disabled", "true");
  try {
    await action();
  } catch (error) {
    notify(error.message);
  } finally {
    button.removeAttribute("aria-disabled");
  }
}

/** Ask in a dialog; return true if the person agreed. What removes nothing looks like the main action. */
export function confirmed(question, explanation, action, look = "danger") {
  return new Promise((resolve) => {
    const title = h("h2", { id: newId("title") }, question);
    const dialog = h(
      "dialog",
      { class: "small", "aria-labelledby": title.id, onclose: () => (dialog.remove(), resolve(dialog.returnValue === "yes")) },
      h(
        "form",
        { method: "dialog" },
        title,
        h("p", null, explanation),
        h(
          "div",
          { class: "row end" },
          h("button", { value: "no", autofocus: true }, t("Cancel")),
          h("button", { value: "yes", class: look }, action),
        ),
      ),
    );
    put(document.body, dialog);
    dialog.showModal();
  });
}

/** Ask for one line of text in a dialog; return it, or null when cancelled. */
export function asked(question, label, action, value = "") {
  return new Promise((resolve) => {
    const input = h("input", { type: "text", required: true, maxlength: 200, value, autofocus: true, autocomplete: "off" });
    const title = h("h2", { id: newId("title") }, question);
    const answer = () => (dialog.returnValue === "yes" ? input.value.trim() || null : null);
    const dialog = h(
      "dialog",
      { class: "small", "aria-labelledby": title.id, onclose: () => (dialog.remove(), resolve(answer())) },
      h(
        "form",
        { method: "dialog" },
        title,
        field(label, input),
        h(
          "div",
          { class: "row end" },
          h("button", { type: "button", onclick: () => dialog.close("no") }, t("Cancel")),
          h("button", { value: "yes", class: "main" }, action),
        ),
      ),
    );
    put(document.body, dialog);
    dialog.showModal();
  });
}

/**
 * Make the buttons of a list one stop of the Tab key; arrow keys, Home and End go from one to the next. A hundred photos
 * would be a hundred stops. `selector` finds the buttons, which may come and go.
 */
export function roving(list, selector) {
  const buttons = () => [...list.querySelectorAll(selector)];
  const choose = (chosen) => buttons().forEach((button) => (button.tabIndex = button === chosen ? 0 : -1));
  list.addEventListener("focusin", (event) => event.target.matches(selector) && choose(event.target));
  list.addEventListener("keydown", (event) => {
    const all = buttons();
    const at = all.indexOf(event.target);
    const places = { ArrowLeft: at - 1, ArrowUp: at - 1, ArrowRight: at + 1, ArrowDown: at + 1, Home: 0, End: all.length - 1 };
    const next = all[places[event.key]];
    if (at < 0 || !next) return;
    event.preventDefault();
    next.focus();
  });
  const update = () => {
    const all = buttons();
    choose(all.find((button) => button === document.activeElement) ?? all[0]);
  };
  new MutationObserver(update).observe(list, { childList: true });
  update();
}
