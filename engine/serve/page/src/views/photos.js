// The photos of a project: choose, drop, take, see, remove.
import { deletePhoto, photoUrl } from "../api.js";
import { projectTrash } from "./trash.js";
import { announce, during, h, notify, setText, show } from "../dom.js";
import { megabytes, percent, plural } from "../format.js";
import { createUploads } from "../upload.js";

export function createPhotos(context) {
  const { id, session } = context;
  const { limits } = session;
  const uploads = createUploads(id, limits, showUploads);
  const tiles = new Map(); // name -> list item, so that pictures are not loaded again
  let idle = () => {};
  let wasBusy = false;
  let known = 0;

  const choose = picker({ multiple: true, accept: "image/*,video/*" });
  const take = picker({ accept: "image/*", capture: "environment" });
  const chooseButton = h("button", { type: "button", class: "main", onclick: () => choose.click() }, "Choose photos");
  const drop = h(
    "div",
    { class: "drop" },
    h("p", { class: "drop-text" }, "Drop photos or videos here, or"),
    h(
      "div",
      { class: "row center" },
      chooseButton,
      h("button", { type: "button", class: "touch-only", onclick: () => take.click() }, "Take a photo"),
    ),
    h("p", { class: "hint" }, "Best are 30 to 100 sharp photos from all sides, with the same light in all of them."),
    choose,
    take,
  );
  const bar = h("progress", { max: 1, "aria-label": "Upload" });
  const sending = h("p");
  const uploading = h("div", { class: "uploading", hidden: true }, sending, bar);
  const refused = h("ul", { class: "refused" });
  const count = h("h2", null, "Photos");
  const rejected = h("p", { class: "problem", hidden: true });
  const grid = h("ul", { class: "photos", tabindex: 0, "aria-label": "Photos" });
  const trash = projectTrash(id, () => context.refresh());
  const element = h("section", { class: "card", "aria-label": "Photos" }, count, drop, uploading, refused, rejected, grid, trash.element);

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
    const present = files.filter((file) => tiles.has(file.name));
    if (present.length > 0 && present.length === files.length) notify(`${plural(present.length, "file")} of this name: already in the project.`);
    const newFiles = files.filter((file) => !tiles.has(file.name));
    const space = limits.project_photos - known;
    if (newFiles.length > space) {
      notify(`A project holds at most ${plural(limits.project_photos, "photo")}. Only the first ${Math.max(space, 0)} are uploaded.`);
    }
    uploads.add(newFiles.slice(0, Math.max(space, 0)));
  }

  function showUploads(files) {
    const active = files.filter((file) => file.state !== "refused");
    const bytes = sum(active, "bytes");
    const isBusy = uploads.busy();
    show(uploading, isBusy);
    if (isBusy) {
      const done = active.filter((file) => file.state === "done").length;
      bar.value = bytes ? sum(active, "sent") / bytes : 0;
      setText(sending, `Uploading: ${done} of ${plural(active.length, "file")}, ${percent(bar.value)} of ${megabytes(bytes)}`);
    }
    const problems = files.filter((file) => file.state === "refused");
    // Rebuilt only when it changes, because the focus may be on one of its buttons.
    const key = problems.map((file) => file.name + file.reason).join("|");
    if (refused.key !== key) {
      refused.key = key;
      refused.replaceChildren(...problems.map(refusedItem));
    }
    if (isBusy !== wasBusy) {
      wasBusy = isBusy;
      if (!isBusy) announce(problems.length ? `Upload finished. ${plural(problems.length, "file")} refused.` : "Upload finished.");
      context.refresh();
      idle();
    }
  }

  function refusedItem(file) {
    const close = h("button", { type: "button", class: "plain", "aria-label": `Hide ${file.name}`, onclick: () => uploads.forget(file) }, "Hide");
    return h("li", null, h("p", null, h("strong", null, file.name), " was not added. ", file.reason), close);
  }

  function update(project) {
    const photos = [...project.photos, ...project.videos];
    known = project.photos.length;
    trash.update(project.removed);
    const bad = photos.filter((photo) => photo.accepted === false).length;
    setText(count, photos.length ? `Photos (${photos.length})` : "Photos");
    setText(chooseButton, photos.length ? "Add photos" : "Choose photos");
    chooseButton.classList.toggle("main", photos.length === 0);
    drop.classList.toggle("slim", photos.length > 0);
    show(rejected, bad > 0);
    setText(rejected, `${plural(bad, "photo")} cannot be used. The reason is under the picture.`);
    show(grid, photos.length > 0);
    const names = new Set(photos.map((photo) => photo.name));
    for (const [name, tile] of tiles) {
      if (names.has(name)) continue;
      tile.remove();
      tiles.delete(name);
    }
    // The unusable ones come first: they need attention.
    const ordered = [...photos].sort((a, b) => (a.accepted === false ? 0 : 1) - (b.accepted === false ? 0 : 1));
    ordered.forEach((photo, index) => {
      const key = `${photo.accepted}|${photo.reason}`;
      let tile = tiles.get(photo.name);
      if (tile?.key !== key) {
        const fresh = tileOf(photo);
        fresh.key = key;
        if (tile) tile.replaceWith(fresh);
        tiles.set(photo.name, fresh);
        tile = fresh;
      }
      if (grid.children[index] !== tile) grid.insertBefore(tile, grid.children[index] ?? null);
    });
  }

  function tileOf(photo) {
    const isVideo = limits.video_types.some((ending) => photo.name.toLowerCase().endsWith(ending));
    const picture = isVideo
      ? h("span", { class: "no-picture" }, "Video")
      : h("img", { src: photoUrl(id, photo.name, 320), alt: photo.name, loading: "lazy", onerror: () => picture.replaceWith(h("span", { class: "no-picture" }, "No picture")) });
    const button = h("button", { type: "button", class: "remove", "aria-label": `Remove ${photo.name}`, title: "Remove", onclick: () => during(button, () => remove(photo)) }, "×");
    return h(
      "li",
      { class: photo.accepted === false ? "bad" : "" },
      picture,
      button,
      h("p", { class: "name" }, photo.name),
      photo.accepted === false ? h("p", { class: "problem" }, photo.reason || "This photo cannot be used.") : null,
    );
  }

  async function remove(photo) {
    await deletePhoto(id, photo.name);
    announce(`${photo.name} was removed.`);
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

function sum(items, key) {
  return items.reduce((total, item) => total + item[key], 0);
}
