// All projects.
import { createProject, listProjects, photoUrl } from "../api.js";
import { suspect } from "../connection.js";
import { asked, during, h, put, refill } from "../dom.js";
import { date, stateText } from "../format.js";
import { deletedProjects } from "./trash.js";
import { plural, t } from "../language.js";

const EVERY = 5000; // Milliseconds between two looks at the states of the projects.

export async function projectsScreen(root) {
  let shown = await listProjects();
  const button = h("button", { type: "button", class: "main", onclick: () => during(button, create) }, t("New project"));
  const place = h("div", { class: "stack" });
  const trash = h("div");
  put(
    root,
    h("div", { class: "row apart" }, h("h1", null, t("Projects")), button),
    place,
    trash,
  );
  fill();
  await showTrash();

  function fill() {
    refill(place, shown.length > 0 ? h("ul", { class: "projects" }, shown.map(item)) : welcome());
  }

  async function showTrash() {
    const deleted = await deletedProjects(async () => {
      shown = await listProjects();
      fill();
      await showTrash();
    });
    refill(trash, deleted);
  }

  /** What waits or works changes by itself. */
  async function refresh() {
    if (document.hidden) return;
    try {
      const news = await listProjects();
      if (JSON.stringify(news) === JSON.stringify(shown)) return;
      shown = news;
      const focused = document.activeElement?.getAttribute("href");
      fill();
      [...place.querySelectorAll("a")].find((link) => link.getAttribute("href") === focused)?.focus();
    } catch {
      suspect();
    }
  }

  const timer = setInterval(refresh, EVERY);
  return () => clearInterval(timer);
}

async function create() {
  const title = await asked(t("New project"), t("Name of the object or room"), t("Create"));
  if (title === null) return;
  const project = await createProject(title);
  location.hash = `#/projects/${encodeURIComponent(project.id)}`;
}

function item(project) {
  const facts = [plural(project.n_photos, "{} photo", "{} photos"), date(project.created)].filter(Boolean).join(" · ");
  return h(
    "li",
    null,
    h(
      "a",
      { href: `#/projects/${encodeURIComponent(project.id)}`, class: "card" },
      cover(project),
      h("h2", null, project.title),
      h("p", null, h("span", { class: `state ${project.state}` }, stateText(project.state))),
      h("p", { class: "quiet" }, facts),
    ),
  );
}

function cover(project) {
  const empty = () => h("span", { class: "no-picture" }, t("No photos yet"));
  if (!project.cover) return empty();
  const picture = h("img", { src: photoUrl(project.id, project.cover, 320), alt: "", loading: "lazy", onerror: () => picture.replaceWith(empty()) });
  return picture;
}

function welcome() {
  const step = (title, text) => h("li", { class: "card" }, h("h2", null, title), h("p", null, text));
  return [
    h("p", { class: "lead" }, t("Turn photos of museum objects into 3D. Press New project to begin.")),
    h(
      "ol",
      { class: "steps" },
      step(t("1. Take photos"), t("Walk around the object and take 30 to 100 photos. Neighbouring photos overlap by two thirds.")),
      step(t("2. Reconstruct"), t("The server computes a 3D scene. You can close this page meanwhile.")),
      step(t("3. Isolate objects"), t("Type a word or click an object. Then download it for your records.")),
    ),
  ];
}
