// What was removed and can be brought back: photos and videos of a project, and projects.
import { emptyTrash, listDeletedProjects, restorePhoto, restoreProject } from "../api.js";
import { announce, confirmed, during, h, refill, setText, show } from "../dom.js";
import { megabytes } from "../format.js";
import { plural, t } from "../language.js";

/** Return {element, update} for the removed photos and videos of a project; `changed` is called when one came back. */
export function projectTrash(id, changed) {
  const summary = h("summary");
  const list = h("ul", { class: "removed" });
  const element = h("details", { class: "trash", hidden: true }, summary, list);

  function update(items) {
    show(element, items.length > 0);
    setText(summary, plural(items.length, "Removed: {} file", "Removed: {} files"));
    const key = items.map((item) => item.id).join("|");
    if (list.key === key) return;
    list.key = key;
    refill(
      list,
      items.map((item) =>
        entry(item.name, item.bytes, async () => {
          const { name } = await restorePhoto(id, item.id);
          announce(t("{} was brought back.", name));
          await changed();
        }),
      ),
    );
  }

  return { element, update };
}

/** Return the deleted projects as an element; `changed` is called when one came back or all are gone. */
export async function deletedProjects(changed) {
  const items = await listDeletedProjects();
  if (items.length === 0) return null;
  const bytes = items.reduce((total, item) => total + item.bytes, 0);
  const empty = h("button", { type: "button", class: "plain", onclick: () => during(empty, emptyAll) }, t("Empty the trash"));

  async function emptyAll() {
    const agreed = await confirmed(t("Empty the trash?"), t("Deleted projects, and photos removed in any project, are gone for good."), t("Empty it"));
    if (!agreed) return;
    await emptyTrash();
    await changed();
  }

  const list = items.map((item) =>
    entry(item.title, item.bytes, async () => {
      await restoreProject(item.id);
      await changed();
    }),
  );
  return h(
    "details",
    { class: "trash" },
    h("summary", null, `${plural(items.length, "Trash: {} project", "Trash: {} projects")}, ${megabytes(bytes)}`),
    h("ul", { class: "removed" }, list),
    empty,
  );
}

function entry(name, bytes, restore) {
  const button = h("button", { type: "button", class: "plain", "aria-label": t("Bring {} back", name), onclick: () => during(button, restore) }, t("Bring back"));
  return h("li", null, `${name} (${megabytes(bytes)}) `, button);
}
