// Start of the page: who is signed in, and which screen belongs to the address.
import { getSession, onSignedOut, signIn, signOut } from "./api.js";
import { watchConnection } from "./connection.js";
import { h, notify, refill, setText } from "./dom.js";
import { fittingLanguage, language, speak, switchLanguage, t } from "./language.js";
import { projectScreen } from "./views/project.js";
import { projectsScreen } from "./views/projects.js";
import { signInScreen } from "./views/sign_in.js";

const main = document.getElementById("main");
let session = null;
let leave = () => {}; // ends the present screen
let shown = 0; // counts screens, so that a slow one does not replace a later one

async function route() {
  const turn = ++shown;
  leave();
  leave = () => {};
  refill(document.getElementById("notices"));
  showTop();
  const root = h("div", { class: "screen" });
  try {
    const end = await screen(root);
    if (turn !== shown) return end();
    leave = end;
  } catch (error) {
    if (turn !== shown) return;
    refill(
      root,
      h("h1", null, t("This page cannot be shown")),
      h("p", null, error.message),
      h("p", null, h("a", { href: "#/", class: "button" }, t("To the projects"))),
    );
  }
  refill(main, root);
  document.title = [root.querySelector("h1")?.textContent, "Gaussian Heritage"].filter(Boolean).join(" – ");
  // Screen readers go on from the new screen, not from the link that was pressed.
  if (turn > 1) main.focus();
  window.scrollTo(0, 0);
}

/** Fill `root` with the screen of the address and return the function that ends it. */
async function screen(root) {
  if (!session?.user) {
    return signInScreen(root, (newSession) => {
      session = newSession;
      route();
    });
  }
  const project = /^#\/projects\/([^/]+)$/.exec(location.hash);
  if (project) return projectScreen(root, session, decodeURIComponent(project[1]));
  return projectsScreen(root);
}

function showTop() {
  const isNamed = session?.user && session.user !== "local";
  refill(
    document.getElementById("top"),
    h("a", { href: "#/", class: "brand" }, "Gaussian Heritage"),
    h("span", { class: "row" }, isNamed ? [h("span", { class: "quiet" }, session.user), signOutButton()] : null, languageChoice()),
  );
}

function languageChoice() {
  const options = Object.entries(session?.languages ?? {}).map(([code, name]) => h("option", { value: code, lang: code }, name));
  const choice = h("select", { class: "plain", "aria-label": t("Language"), onchange: () => switchLanguage(choice.value) }, options);
  choice.value = language();
  return choice;
}

/** Fetch the table of the language that fits this browser, and say in it what the page has from its start. */
async function chooseLanguage() {
  const code = fittingLanguage(Object.keys(session.languages));
  if (code === language()) return;
  const response = await fetch(`languages/${code}.json`).catch(() => null);
  if (!response?.ok) return; // English is better than nothing.
  speak(code, await response.json());
  setText(document.getElementById("skip"), t("Skip to the content"));
  document.getElementById("notices").setAttribute("aria-label", t("Messages"));
}

function signOutButton() {
  const action = async () => {
    await signOut().catch((error) => notify(error.message));
    session = await getSession().catch(() => null);
    location.hash = "#/";
    route();
  };
  return h("button", { type: "button", class: "plain", onclick: action }, t("Sign out"));
}

onSignedOut(async () => {
  session = await getSession().catch(() => null);
  if (!session?.user) route();
});
document.getElementById("skip").addEventListener("click", (event) => {
  event.preventDefault(); // The hash belongs to the screens.
  main.focus();
});
window.addEventListener("hashchange", route);
try {
  session = await getSession();
  await chooseLanguage();
  const code = /^#\/sign-in\/([\w-]+)$/.exec(location.hash);
  if (code) {
    // Of the QR code that the server showed. It serves once and must not stay in the history.
    history.replaceState(null, "", "#/");
    if (!session.user) session = await signIn(code[1]);
  }
} catch (error) {
  notify(error.message);
}
watchConnection();
route();
