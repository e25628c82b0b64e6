// The renderer is large, so it is loaded only when there is a scene. This file lies beside viewer.js, in src/ as in dist/.
import { t } from "./language.js";

export async function startViewer(canvas, options) {
  let module;
  try {
    module = await import("./viewer.js");
  } catch {
    throw new Error(t("The viewer could not be loaded. Load the page again."));
  }
  return module.createViewer(canvas, { ...options, t });
}
