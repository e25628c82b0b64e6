// The finished scene: viewer on the left, objects on the right.
import { getCameras } from "../api.js";
import { h, notify, show } from "../dom.js";
import { createClicks } from "./clicks.js";
import { createObjects } from "./objects.js";
import { createStage } from "./stage.js";
import { t } from "../language.js";

export function createResult(context) {
  let shown = ""; // state of the scene that the viewer has
  let cameras = null; // a promise, as both the viewer and the clicks need them
  const stage = createStage(context, {
    sceneShown: () => objects.shownAlone(null),
    looksChanged: () => objects.looksChanged(),
    openPhoto: (click) => clicks.open({ photo: click.photo, click }),
  });
  const clicks = createClicks(context, () => cameras);
  const objects = createObjects(context, { stage, clicks });
  const element = h("section", { class: "result", "aria-label": t("Result"), hidden: true }, stage.element, objects.element);

  function update(project) {
    show(element, Boolean(project.scene));
    if (!project.scene) return;
    if (project.scene.state !== shown) {
      shown = project.scene.state;
      cameras = getCameras(context.id);
      cameras.then((read) => stage.start(read)).catch((error) => notify(error.message));
    }
    objects.update(project);
  }

  return { element, update, dispose: stage.dispose };
}
