// All projects.
import { createProject, listProjects } from "../api.js";
import { asked, during, h } from "../dom.js";
import { date, plural, stateText } from "../format.js";
import { deletedProjects } from "./trash.js";

export async function projectsScreen(root) {
  const projects = await listProjects();
  const button = h("button", { type: "button", class: "main", onclick: () => during(button, create) }, "New project");
  root.append(
    h("div", { class: "row apart" }, h("h1", null, "Projects"), button),
    projects.length > 0 ? h("ul", { class: "projects" }, projects.map(item)) : welcome(),
  );
  const trash = await deletedProjects(async () => {
    root.replaceChildren();
    await projectsScreen(root);
  });
  if (trash) root.append(trash);
  return () => {};
}

async function create() {
  const title = await asked("New project", "Name of the object or room", "Create");
  if (title === null) return;
  const project = await createProject(title);
  location.hash = `#/projects/${encodeURIComponent(project.id)}`;
}

function item(project) {
  const facts = [plural(project.n_photos, "photo"), date(project.created)].filter(Boolean).join(" · ");
  return h(
    "li",
    null,
    h(
      "a",
      { href: `#/projects/${encodeURIComponent(project.id)}`, class: "card" },
      h("h2", null, project.title),
      h("p", null, h("span", { class: `state ${project.state}` }, stateText(project.state))),
      h("p", { class: "quiet" }, facts),
    ),
  );
}

function welcome() {
  const step = (title, text) => h("li", { class: "card" }, h("h2", null, title), h("p", null, text));
  return [
    h("p", { class: "lead" }, "Turn photos of museum objects into 3D. Press New project to begin."),
    h(
      "ol",
      { class: "steps" },
      step("1. Take photos", "Walk around the object and take 30 to 100 photos. Neighbouring photos overlap by two thirds."),
      step("2. Reconstruct", "The server computes a 3D scene. You can close this page meanwhile."),
      step("3. Isolate objects", "Type a word or click an object. Then download it for your records."),
    ),
  ];
}
