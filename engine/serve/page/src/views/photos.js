// The photos of a project: choose, drop, take, see, remove.
import { deletePhoto, photoUrl, startJob } from "../api.js";
import { announce, confirmed, during, h, notify, refill, roving, setText, show } from "../dom.js";
import { megabytes, percent } from "../format.js";
import { createUploads } from "../upload.js";
import { projectTrash } from "./trash.js";
import { plural, said, t } from "../language.js";

const DENSEST = 8; // How many times as many photos of a video as usual can be taken.

export function createPhotos(context) {
  const { id, session } = context;
  const { limits } = session;
  const uploads = createUploads(id, limits, showUploads);
  const tiles = new Map(); // name -> list item, so that pictures are not loaded again
  let idle = () => {};
  let wasBusy = false;
  let known = 0;

  // Not every system knows HEIC and MKV as pictures and videos, so their endings are named too.
  const choose = picker({ multiple: true, accept: ["image/*", "video/*", ...limits.photo_types, ...limits.video_types].join() });
  const take = picker({ accept: "image/*", capture: "environment" });
  const chooseButton = h("button", { type: "button", class: "main", onclick: () => choose.click() }, t("Choose photos"));
  const drop = h(
    "div",
    { class: "drop" },
    h("p", { class: "drop-text" }, t("Drop photos or videos here, or")),
    h(
      "div",
      { class: "row center" },
      chooseButton,
      h("button", { type: "button", class: "touch-only", onclick: () => take.click() }, t("Take a photo")),
    ),
    h("p", { class: "hint" }, t("Best are 30 to 100 sharp photos from all sides, with the same light in all of them.")),
    choose,
    take,
  );
  const bar = h("progress", { max: 1, "aria-label": t("Upload") });
  const sending = h("p");
  const uploading = h("div", { class: "uploading", hidden: true }, sending, bar);
  const refused = h("ul", { class: "refused" });
  const count = h("h2", null, t("Photos"));
  const rejected = h("p", { class: "problem", hidden: true });
  const grid = h("ul", { class: "photos", tabindex: 0, "aria-label": t("Photos") });
  const trash = projectTrash(id, () => context.refresh());
  const element = h("section", { class: "card", "aria-label": t("Photos") }, count, drop, uploading, refused, rejected, grid, trash.element);

  roving(grid, "button");

  // A file dropped beside the area must not replace the page.
  const ending = new AbortController();
  for (const name of ["dragover", "drop"]) {
    window.addEventListener(name, (event) => event.preventDefault(), { signal: ending.signal });
  }
  const leaving = (event) => uploads.busy() && event.preventDefault();
  window.addEventListener("beforeunload", leaving, { signal: ending.signal });
  element.addEventListener("dragover", () => element.classList.add("over"));
  element.addEventListener("dragleave", () => element.classList.remove("over"));
  element.addEventListener("drop", (event) => {
    event.preventDefault();
    element.classList.remove("over");
    add([...event.dataTransfer.files]);
  });

  function picker(props) {
    const input = h("input", { type: "file", hidden: true, ...props });
    input.addEventListener("change", () => {
      add([...input.files]);
      input.value = ""; // The same file may be chosen again.
    });
    return input;
  }

  function add(files) {
    // Names tell nothing: the camera of a phone calls each photo image.jpg. The server compares the contents.
    const space = Math.max(limits.project_photos - known, 0);
    if (files.length > space) {
      notify(t("A project holds at most {} photos. Only the first {} are uploaded.", limits.project_photos, space));
    }
    uploads.add(files.slice(0, space));
  }

  function showUploads(files) {
    const active = files.filter((file) => file.state !== "refused");
    const bytes = sum(active, "bytes");
    const isBusy = uploads.busy();
    show(uploading, isBusy);
    if (isBusy) {
      const done = active.filter((file) => file.state === "done").length;
      bar.value = bytes ? sum(active, "sent") / bytes : 0;
      setText(sending, t("Uploading: {} of {}, {} of {}", done, plural(active.length, "{} file", "{} files"), percent(bar.value), megabytes(bytes)));
    }
    const problems = files.filter((file) => file.state === "refused");
    // Rebuilt only when it changes, because the focus may be on one of its buttons.
    const key = problems.map((file) => file.name + file.reason).join("|");
    if (refused.key !== key) {
      refused.key = key;
      refill(refused, ...problems.map(refusedItem));
    }
    if (isBusy !== wasBusy) {
      wasBusy = isBusy;
      if (!isBusy) announce([t("Upload finished."), problems.length ? plural(problems.length, "{} file refused.", "{} files refused.") : ""].join(" "));
      context.refresh();
      idle();
    }
  }

  function refusedItem(file) {
    const close = h("button", { type: "button", class: "plain", "aria-label": t("Hide {}", file.name), onclick: () => uploads.forget(file) }, t("Hide"));
    return h("li", null, h("p", null, h("strong", null, file.name), " ", t("was not added."), " ", file.reason), close);
  }

  function update(project) {
    const { photos } = project;
    known = photos.length;
    trash.update(project.removed);
    const bad = photos.filter((photo) => photo.accepted === false).length;
    setText(count, photos.length ? t("Photos ({})", photos.length) : t("Photos"));
    setText(chooseButton, t(photos.length ? "Add photos" : "Choose photos"));
    chooseButton.classList.toggle("main", photos.length === 0);
    drop.classList.toggle("slim", photos.length > 0);
    show(rejected, bad > 0);
    setText(rejected, plural(bad, "{} photo cannot be used. The reason is under the picture.", "{} photos cannot be used. The reasons are under the pictures."));
    const videos = project.videos.map((video) => ({ ...video, isVideo: true, accepted: video.problem ? false : null }));
    show(grid, photos.length + videos.length > 0);
    const all = [...videos, ...photos];
    const names = new Set(all.map(tileName));
    for (const [name, tile] of tiles) {
      if (names.has(name)) continue;
      tile.remove();
      tiles.delete(name);
    }
    // The unusable ones come first: they need attention.
    const ordered = all.sort((a, b) => (a.accepted === false ? 0 : 1) - (b.accepted === false ? 0 : 1));
    ordered.forEach((photo, index) => {
      const key = JSON.stringify([photo.accepted, photo.reason, photo.problem, photo.stopped, photo.n_photos, photo.density]);
      let tile = tiles.get(tileName(photo));
      if (tile?.key !== key) {
        const fresh = photo.isVideo ? videoTile(photo) : tileOf(photo);
        fresh.key = key;
        if (tile) tile.replaceWith(fresh);
        tiles.set(tileName(photo), fresh);
        tile = fresh;
      }
      if (grid.children[index] !== tile) grid.insertBefore(tile, grid.children[index] ?? null);
    });
  }

  function tileOf(photo) {
    const noPicture = () => picture.replaceWith(h("span", { class: "no-picture" }, t("No picture")));
    const picture = h("img", { src: photoUrl(id, photo.name, 320), alt: photo.name, loading: "lazy", onerror: noPicture });
    return h(
      "li",
      { class: photo.accepted === false ? "bad" : "" },
      picture,
      removeButton(photo),
      h("p", { class: "name", title: photo.name }, photo.name),
      photo.accepted === false ? h("p", { class: "problem" }, photo.reason ? said(photo.reason) : t("This photo cannot be used.")) : null,
    );
  }

  function removeButton(item) {
    const action = () => during(button, () => remove(item));
    const button = h("button", { type: "button", class: "remove", "aria-label": t("Remove {}", item.name), title: t("Remove"), onclick: action }, "×");
    return button;
  }

  /** A video with what became of it: how many photos, or why none; and a button that takes more of them. */
  function videoTile(video) {
    const denser = video.stopped ? video.density : Math.min(2 * (video.density || 1), DENSEST);
    const take = () => startJob(id, { kind: "frames", video: video.name, density: denser }).then(context.refresh);
    const more = h("button", { type: "button", class: "small", onclick: () => during(more, take) }, t(video.stopped ? "Take photos" : "Take more photos"));
    const nothing = video.stopped ? t("Taking photos from it was stopped") : t("No photos taken from it yet");
    const state = said(video.problem) || (video.n_photos > 0 ? plural(video.n_photos, "{} photo taken from it", "{} photos taken from it") : nothing);
    return h(
      "li",
      { class: video.problem ? "video bad" : "video" },
      h("span", { class: "no-picture" }, t("Video")),
      removeButton(video),
      h("p", { class: "name", title: video.name }, video.name),
      h("p", { class: video.problem ? "problem" : "hint" }, state),
      video.problem ? h("p", { class: "hint" }, t("Remove it, then choose a copy that plays.")) : null,
      video.stopped || (video.n_photos > 0 && denser > video.density) ? more : null,
    );
  }

  async function remove(item) {
    const kept = item.isVideo && item.n_photos > 0 ? t("The photos that were taken from it stay.") : "";
    const told = `${t("It is moved to the removed files below the photos, and can be brought back.")} ${kept}`;
    const sure = await confirmed(t("Remove “{}”?", item.name), told, t("Remove"));
    if (!sure) return;
    await deletePhoto(id, item.name);
    announce(t("{} was removed.", item.name));
    await context.refresh();
    grid.focus();
  }

  return {
    element,
    update,
    busy: uploads.busy,
    onIdle: (action) => (idle = action),
    dispose: () => {
      uploads.stop();
      ending.abort();
    },
  };
}

/** A video and a photo may have one name. */
function tileName(item) {
  return `${item.isVideo ? "video" : "photo"} ${item.name}`;
}

function sum(items, key) {
  return items.reduce((total, item) => total + item[key], 0);
}
