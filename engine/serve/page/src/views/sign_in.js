// Sign in with the token that the person who runs the server gave out.
import { signIn } from "../api.js";
import { during, field, h, put } from "../dom.js";
import { t } from "../language.js";

export function signInScreen(root, done) {
  const token = h("input", { type: "password", required: true, autocomplete: "current-password", name: "token" });
  const problem = h("p", { class: "problem", role: "alert" });
  const button = h("button", { class: "main" }, t("Sign in"));
  const submit = (event) => {
    event.preventDefault();
    during(button, async () => {
      problem.textContent = "";
      try {
        done(await signIn(token.value));
      } catch (error) {
        problem.textContent = error.message;
        token.focus();
      }
    });
  };
  put(
    root,
    h(
      "form",
      { class: "card narrow", onsubmit: submit },
      h("h1", null, t("Sign in")),
      field(t("Access token"), token, t("You have it from the person who runs this server.")),
      problem,
      button,
    ),
  );
  return () => {};
}
