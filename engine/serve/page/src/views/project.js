// One project: photos, reconstruction, result. The server's state is read again after each event and given to the parts.
import { isActive } from "../jobs.js";
import { deleteProject, eventsUrl, getProject, renameProject, reportUrl, sceneExportUrl } from "../api.js";
import { asked, confirmed, during, h, notify, put, show } from "../dom.js";
import { listen } from "../events.js";
import { onBack } from "../connection.js";
import { decimal } from "../format.js";
import { createPhotos } from "./photos.js";
import { createProgress } from "./progress.js";
import { createReconstruct } from "./reconstruct.js";
import { createResult } from "./result.js";
import { plural, said, t } from "../language.js";

export async function projectScreen(root, session, id) {
  const read = await getProject(id);
  let project = { ...read, job: present(read) };
  let reading = false;
  let readAgain = false;
  let ended = false;

  /** Read the project from the server; calls during a reading lead to one more. */
  async function refresh() {
    if (reading) {
      readAgain = true;
      return;
    }
    reading = true;
    try {
      do {
        readAgain = false;
        const news = await getProject(id);
        if (ended) return;
        update(news);
      } while (readAgain);
    } catch (error) {
      if (!ended) notify(error.message);
    } finally {
      reading = false;
    }
  }

  const context = { id, session, refresh, busy: () => isActive(project.job) };
  const photos = createPhotos(context);
  const reconstruct = createReconstruct(context, photos);
  const progress = createProgress(context);
  const result = createResult(context);

  const title = h("h1", null, project.title);
  const report = h("a", { class: "button", href: reportUrl(id), target: "_blank", rel: "noopener" }, t("Report"));
  const sceneFile = ({ name, label }) => h("li", null, h("a", { class: "button", href: sceneExportUrl(id, name), download: "" }, t(label)));
  const scenes = h("details", { class: "downloads menu" }, h("summary", null, t("Download the scene")), h("ul", { class: "row" }, session.formats.filter((one) => one.of_scenes).map(sceneFile)));
  const files = [report, scenes];
  const rename = h("button", { type: "button", onclick: () => during(rename, renameThis) }, t("Rename"));
  const remove = h("button", { type: "button", class: "danger-text", onclick: () => during(remove, removeThis) }, t("Delete project"));
  const facts = h("p", { class: "quiet facts", hidden: true });
  const health = h("p", { class: "problem" }); // what the check of the cameras found
  // With a scene, the photos are of less interest and are folded.
  const summary = h("summary", null, t("Photos and reconstruction"));
  const inside = h("div", { class: "stack" });
  const folded = h("details", { class: "card fold" }, summary, inside);
  const open = h("div", { class: "stack" });

  async function renameThis() {
    const newTitle = await asked(t("Rename the project"), t("Name"), t("Rename"), project.title);
    if (newTitle === null) return;
    await renameProject(id, newTitle);
    await refresh();
  }

  async function removeThis() {
    const sure = await confirmed(
      t("Delete “{}”?", project.title),
      t("The photos, the scene and all objects are moved to the trash, below the list of projects."),
      t("Delete project"),
    );
    if (!sure) return;
    await deleteProject(id);
    location.hash = "#/";
  }

  function update(news) {
    project = { ...news, job: present(news) };
    if (title.textContent !== project.title) {
      title.textContent = project.title;
      document.title = `${project.title} – Gaussian Heritage`;
    }
    const hasScene = Boolean(project.scene);
    const isFirst = !hasScene || (isActive(project.job) && project.job.kind === "reconstruct");
    for (const file of files) show(file, hasScene);
    show(facts, hasScene);
    facts.textContent = hasScene ? sceneFacts(project) : "";
    health.textContent = said(project.scene?.cameras ?? "");
    const place = hasScene ? inside : open;
    if (photos.element.parentElement !== place) put(place, photos.element, reconstruct.element);
    show(folded, hasScene);
    show(open, !hasScene);
    photos.update(project);
    reconstruct.update(project);
    // Jobs of objects are shown beside the objects.
    progress.update(isShown(project.job, isFirst) ? project.job : null, project.waiting);
    result.update(project);
  }

  put(
    root,
    h("p", { class: "back" }, h("a", { href: "#/" }, t("← All projects"))),
    h("div", { class: "row apart" }, title, h("div", { class: "row" }, files, rename)),
    facts,
    health,
    progress.element,
    open,
    result.element,
    folded,
    h("p", { class: "foot" }, remove),
  );
  update(project);

  const forgetBack = onBack(refresh);
  const stopListening = listen(eventsUrl(id), {
    job: (job) => {
      const wasActive = isActive(project.job);
      // Finished jobs change much more than themselves.
      if (job.id !== project.job?.id || wasActive !== isActive(job)) refresh();
      else update({ ...project, job });
    },
    waiting: refresh,
    photos: refresh,
    objects: refresh,
    scene: refresh,
    reconnected: refresh,
  });
  return () => {
    ended = true;
    stopListening();
    forgetBack();
    photos.dispose();
    reconstruct.dispose();
    result.dispose();
  };
}

/** The job that works or, without one, that waits for its turn; otherwise the last one. */
function present({ job, waiting }) {
  return isActive(job) || waiting.length === 0 ? job : waiting[0];
}

/** Whether the progress at the top is that of a job: the tile of a video tells why it gave no photos. */
function isShown(job, isFirst) {
  if (job?.kind === "frames") return isActive(job);
  return isFirst || job?.kind !== "segment";
}

function sceneFacts(project) {
  const parts = [
    plural(project.n_photos, "{} photo", "{} photos"),
    plural(project.scene.n_gaussians, "{} Gaussian", "{} Gaussians"),
  ];
  if (project.scene.psnr) parts.push(t("quality {} dB (PSNR)", decimal(project.scene.psnr)));
  return parts.join(" · ");
}
