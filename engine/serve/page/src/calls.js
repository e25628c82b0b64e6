// Further requests to the server, see api.js.
import { address, request } from "./api.js";
import { t } from "./language.js";

/** Return low, expected and high seconds of a reconstruction by preset. */
export const getForecast = (id) => request("GET", address("projects", id, "forecast"));

/** Return which Gaussians of the scene belong to an object: {count, bits}, see object_looks.js. */
export async function getMembers(id, object) {
  const response = await fetch(address("projects", id, "objects", object, "members"), { credentials: "same-origin" }).catch(() => null);
  if (!response?.ok) throw new Error(t("It could not be read what belongs to the object. Load the page again."));
  return { count: Number(response.headers.get("x-count")), bits: new Uint8Array(await response.arrayBuffer()) };
}
