// Choose an object by clicks in a photo: a dialog with the photo, dots for the clicks, and the photos to switch between.
import { startJob, viewUrl } from "../api.js";
import { announce, during, field, h, newId, notify, put, refill, setText, show, svg } from "../dom.js";
import { t } from "../language.js";

const SIDE = 1600;
const STEP = 0.02; // Share of the photo that an arrow key moves the cross.

/** `cameras()` returns a promise of the cameras, whose views are the photos that can be clicked. */
export function createClicks(context, cameras) {
  /** Open the dialog: for a new object, or to correct `object`. It starts with `photo`, or the first, and with `click`. */
  async function open({ object = null, photo = "", click = null } = {}) {
    const { views } = await cameras();
    if (views.length === 0) {
      notify(t("There is no photo to click in."));
      return;
    }
    const first = Math.max(0, views.findIndex((view) => view.photo === photo));
    showDialog(context, views, first, object, click ? [click] : []);
  }

  return { open };
}

/** `clicks` are those that are set already: {photo, x, y, wanted}, in pixels of the photo. */
function showDialog(context, views, first, object, clicks) {
  const { id } = context;
  let index = first;
  let cross = [0.5, 0.5]; // place of the keyboard's cross, as shares of the photo

  const name = newId("kind");
  const wanted = h("input", { type: "radio", name, checked: true });
  const unwanted = h("input", { type: "radio", name });
  const image = h("img", { alt: "", draggable: "false" });
  const dots = svg("svg", { class: "dots", "aria-hidden": "true" });
  const target = h("div", { class: "target", tabindex: 0, role: "application" }, image, dots);
  const position = h("span", { class: "position" });
  const state = h("p", { class: "hint", "aria-live": "polite" });
  const title = h("h2", { id: newId("title") }, object ? t("Correct “{}”", object.name) : t("Click an object"));
  const nameInput = h("input", { type: "text", maxlength: 300, autocomplete: "off" });
  const button = (text, action, props) => h("button", { type: "button", onclick: action, ...props }, text);
  const previous = button("‹", () => go(-1), { "aria-label": t("Previous photo") });
  const next = button("›", () => go(1), { "aria-label": t("Next photo") });
  const undo = button(t("Undo"), undoLast);
  const done = button(t("Done"), () => during(done, finish), { class: "main" });
  const dialog = h(
    "dialog",
    { class: "clicks", "aria-labelledby": title.id, onclose: () => dialog.remove() },
    h("div", { class: "row apart" }, title, h("div", { class: "row" }, previous, position, next)),
    h("div", { class: "target-box" }, target),
    h(
      "div",
      { class: "row apart bottom" },
      h(
        "fieldset",
        { class: "toggle" },
        h("legend", { class: "hidden-text" }, t("What the next click means")),
        h("label", { class: "part" }, wanted, t("Part of it")),
        h("label", { class: "not-part" }, unwanted, t("Not part of it")),
      ),
      object ? null : field(t("Name (you can give it later)"), nameInput),
      h("div", { class: "row" }, undo, button(t("Cancel"), () => dialog.close()), done),
    ),
    state,
  );

  function go(step) {
    index = (index + step + views.length) % views.length;
    showPhoto();
  }

  function showPhoto() {
    const view = views[index];
    image.src = viewUrl(id, view.photo, SIDE);
    image.width = view.width; // The page does not jump while the photo loads.
    image.height = view.height;
    dots.setAttribute("viewBox", `0 0 ${view.width} ${view.height}`);
    setText(position, t("{} of {}", index + 1, views.length));
    const help = t("Photo {}. Arrow keys move the cross, Enter sets a dot, Shift and Enter sets a dot that is not part.", view.photo);
    target.setAttribute("aria-label", help);
    cross = [0.5, 0.5];
    draw();
  }

  function draw() {
    const view = views[index];
    const size = view.width / 60;
    const here = clicks.filter((click) => click.photo === view.photo);
    const [x, y] = [cross[0] * view.width, cross[1] * view.height];
    const arm = 1.5 * size;
    const path = `M${x - arm} ${y}H${x + arm}M${x} ${y - arm}V${y + arm}`;
    refill(
      dots,
      ...here.map((click) => dotShape(click, size)),
      svg("path", { class: "cross under", d: path }),
      svg("path", { class: "cross", d: path }),
    );
    const some = clicks.some((click) => click.wanted);
    const count = (value) => clicks.filter((click) => click.wanted === value).length;
    undo.disabled = clicks.length === 0;
    done.disabled = clicks.length === 0 || (!object && !some);
    if (clicks.length > 0) setText(state, t("{} on the object, {} not part of it.", count(true), count(false)));
    else if (object) setText(state, t("Click what is missing. For what does not belong to it, choose “Not part of it” or hold Shift."));
    else setText(state, t("Click the object once or several times. For what does not belong to it, choose “Not part of it” or hold Shift."));
  }

  function setClick(share, shift) {
    const view = views[index];
    const isWanted = shift ? !wanted.checked : wanted.checked;
    clicks.push({ photo: view.photo, x: round(share[0] * view.width), y: round(share[1] * view.height), wanted: isWanted });
    draw();
  }

  function undoLast() {
    const last = clicks.pop();
    if (last && last.photo !== views[index].photo) {
      index = views.findIndex((view) => view.photo === last.photo);
      showPhoto();
    }
    draw();
    if (clicks.length === 0) target.focus(); // Undo is disabled now.
  }

  async function finish() {
    const job = { kind: "segment", clicks };
    if (object) job.object = object.id;
    else job.name = nameInput.value.trim();
    await startJob(id, job);
    dialog.close();
    announce(t("The object is being computed."));
    await context.refresh();
  }

  target.addEventListener("click", (event) => {
    const box = image.getBoundingClientRect();
    const share = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
    if (share.every((value) => value >= 0 && value <= 1)) setClick(share, event.shiftKey);
  });
  target.addEventListener("keydown", (event) => {
    const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    if (event.key === "Enter" || event.key === " ") setClick(cross, event.shiftKey);
    else if (moves[event.key]) cross = cross.map((value, axis) => Math.min(1, Math.max(0, value + STEP * moves[event.key][axis])));
    else return;
    event.preventDefault();
    draw();
  });
  image.addEventListener("error", () => setText(state, t("The photo could not be loaded. Try another one.")));

  show(position, views.length > 1);
  put(document.body, dialog);
  showPhoto();
  dialog.showModal();
  target.focus();
}

/** A filled circle for wanted, a ring with a bar for not wanted: told apart without colour too. */
function dotShape(click, size) {
  const circle = svg("circle", { cx: click.x, cy: click.y, r: size });
  const bar = svg("line", { x1: click.x - size / 2, x2: click.x + size / 2, y1: click.y, y2: click.y });
  const upright = svg("line", { x1: click.x, x2: click.x, y1: click.y - size / 2, y2: click.y + size / 2 });
  return svg("g", { class: click.wanted ? "dot wanted" : "dot unwanted" }, circle, bar, click.wanted ? upright : null);
}

function round(value) {
  return Math.round(value * 10) / 10;
}
