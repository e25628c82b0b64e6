// The language of the page. Texts are English where they are used; the tables of other languages have them by the English ones.
const KEPT = "heritage language";

let code = "en";
let texts = {};
let forms = []; // [pattern, own form] of what the engine says

/** Return the code of the page's language, such as "de". */
export function language() {
  return code;
}

/** Return an English text in the language of the page, with `values` in its places {}. */
export function t(text, ...values) {
  const found = texts[text] ?? text;
  return values.length ? filled(found, values) : found;
}

/** Return a sentence of the engine in the language of the page, or as it is where no form fits it. */
export function said(sentence) {
  // A whole text may fit a form too, such as "{} of {}".
  for (const [pattern, own] of Object.hasOwn(texts, sentence) ? [] : forms) {
    const found = pattern.exec(sentence);
    if (found) return filled(own, found.slice(1));
  }
  return t(sentence);
}

function filled(text, values) {
  let next = 0;
  return text.replace(/\{\}/g, () => values[next++]);
}

/** Return how numbers and dates are written: as in the country that the browser names, such as "de-CH". */
export function locale() {
  return navigator.languages.find((each) => each.split("-")[0] === code) ?? code;
}

/** Return a number with what is counted: plural(3, "{} photo", "{} photos"). */
export function plural(count, one, many) {
  const isOne = new Intl.PluralRules(locale()).select(count) === "one";
  return t(isOne ? one : many, count.toLocaleString(locale()));
}

/** Return the code that fits this browser best: of its choice before, or of the languages of its user. */
export function fittingLanguage(offered) {
  const wanted = [kept(), ...navigator.languages.map((each) => each.split("-")[0])];
  return wanted.find((each) => offered.includes(each)) ?? "en";
}

/** From now on, `t` and `said` return what the table of a language has: {texts, sentences}. */
export function speak(newCode, table) {
  code = newCode;
  texts = table.texts;
  // Those with most words first: their sentences may fit a shorter form too.
  const longest = Object.entries(table.sentences).sort(([a], [b]) => b.length - a.length);
  forms = longest.map(([form, own]) => [new RegExp(`^${form.split("{}").map(escaped).join("(.+?)")}$`, "s"), own]);
  document.documentElement.lang = code;
}

/** Show the page in another language, now and whenever this browser opens it. */
export function switchLanguage(newCode) {
  try {
    localStorage.setItem(KEPT, newCode);
  } catch {
    return; // Storage is switched off: the languages of the browser decide.
  }
  location.reload();
}

function escaped(text) {
  return text.replace(/[.*+?^${}()|[\]\\]/g, "\\$&");
}

function kept() {
  try {
    return localStorage.getItem(KEPT);
  } catch {
    return null;
  }
}
