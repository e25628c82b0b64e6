// Words asked of the scene while it is trained: what its last checkpoint shows of them.
import { askScene } from "../api.js";
import { announce, during, field, h, refill, setText, show } from "../dom.js";
import { said, t } from "../language.js";

export function createAsk({ id }) {
  const words = h("input", { type: "text", required: true, autocomplete: "off", maxlength: 500, placeholder: "vase, teapot", enterkeyhint: "go" });
  const ask = h("button", null, t("Ask the scene so far"));
  const form = h(
    "form",
    { class: "prompt", onsubmit: (event) => (event.preventDefault(), during(ask, answer)) },
    h("div", { class: "row bottom" }, field(t("What is in it?"), words), ask),
  );
  const told = h("p", { class: "quiet" });
  const list = h("ul", { class: "candidates" });
  const element = h("div", { class: "stack", hidden: true }, form, told, list);

  async function answer() {
    setText(told, t("Looking. This may take some minutes."));
    refill(list);
    let seen;
    try {
      seen = await askScene(id, words.value.trim());
    } catch (error) {
      setText(told, error.message);
      announce(error.message);
      return;
    }
    const reasons = Object.values(seen.refused).map(said);
    setText(told, [t("The scene after step {} of its training. Nothing is stored.", seen.step), ...reasons].join(" "));
    refill(list, ...seen.found.map(({ text, photo, picture }) => h("li", null, h("img", { src: picture, alt: "" }), h("span", null, t("{} in {}", text, photo)))));
    announce(told.textContent);
  }

  /** Show it while the scene is trained. */
  function update(job) {
    show(element, job.state === "running" && job.kind === "reconstruct" && job.stage === "training");
  }

  return { element, update };
}
