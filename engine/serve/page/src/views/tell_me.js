// A notification when a job ends, if the person wants one and the browser allows it; and the title of the tab.
import { during, h, notify, show } from "../dom.js";
import { t } from "../language.js";

export function createTellMe() {
  let wanted = false;
  const button = h("button", { type: "button", "aria-pressed": "false", onclick: () => during(button, toggle) }, t("Notify me at the end"));

  async function toggle() {
    if (!wanted && !(await isAllowed())) {
      return notify(t("This browser shows no notifications for this page. The title of the tab says when the work has ended."));
    }
    wanted = !wanted;
    button.setAttribute("aria-pressed", String(wanted));
  }

  /** A job of this page has ended: `text` says how. */
  function ended(text) {
    if (!document.hidden) return;
    const before = document.title;
    document.title = `✓ ${text}`;
    document.addEventListener("visibilitychange", () => (document.title = before), { once: true });
    if (!wanted) return;
    try {
      const notice = new Notification("Gaussian Heritage", { body: text });
      notice.onclick = () => window.focus();
    } catch {
      // Some phones allow notifications of installed pages only; the title says it.
    }
  }

  function update(isRunning) {
    show(button, isRunning);
  }

  return { button, ended, update };
}

async function isAllowed() {
  if (!("Notification" in window)) return false;
  if (Notification.permission === "default") await Notification.requestPermission();
  return Notification.permission === "granted";
}
