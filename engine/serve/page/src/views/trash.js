// What was removed and can be brought back: photos and videos of a project, and projects.
import { emptyTrash, listDeletedProjects, restorePhoto, restoreProject } from "../api.js";
import { announce, confirmed, during, h, refill, setText, show } from "../dom.js";
import { megabytes, plural } from "../format.js";

/** Return {element, update} for the removed photos and videos of a project; `changed` is called when one came back. */
export function projectTrash(id, changed) {
  const summary = h("summary");
  const list = h("ul", { class: "removed" });
  const element = h("details", { class: "trash", hidden: true }, summary, list);

  function update(items) {
    show(element, items.length > 0);
    setText(summary, `Removed: ${plural(items.length, "file")}`);
    const key = items.map((item) => item.id).join("|");
    if (list.key === key) return;
    list.key = key;
    refill(
      list,
      items.map((item) =>
        entry(item.name, item.bytes, async () => {
          const { name } = await restorePhoto(id, item.id);
          announce(`${name} was brought back.`);
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
  const empty = h("button", { type: "button", class: "plain", onclick: () => during(empty, emptyAll) }, "Empty the trash");

  async function emptyAll() {
    const agreed = await confirmed("Empty the trash?", "Deleted projects, and photos removed in any project, are gone for good.", "Empty it");
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
    h("summary", null, `Trash: ${plural(items.length, "project")}, ${megabytes(bytes)}`),
    h("ul", { class: "removed" }, list),
    empty,
  );
}

function entry(name, bytes, restore) {
  const button = h("button", { type: "button", class: "plain", "aria-label": `Bring ${name} back`, onclick: () => during(button, restore) }, "Bring back");
  return h("li", null, `${name} (${megabytes(bytes)}) `, button);
}
