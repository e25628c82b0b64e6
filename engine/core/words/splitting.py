"""Prompts of several objects, as people type them: "vase, teapot and drum"."""

from __future__ import annotations

import functools
import re
from collections.abc import Sequence
from dataclasses import dataclass

from .vocabulary_words import adjectives, normalised, word_list

_QUOTES = ('""', "“”", "„“", "„”", "«»", "»«", "‘’", "‚‘", "''")
_QUOTED_FORMS = "|".join(rf"{first}(?:[^{last}\n]|{last}(?=\w))+{last}" for first, last in map(tuple, _QUOTES))
_QUOTED = re.compile(rf"(?<!\w)(?:{_QUOTED_FORMS})(?!\w)")
_LIST_MARK = re.compile(r"^\s*(?:[-*–—•·]\s+|\(?\d{1,3}[.)]\s+)", re.MULTILINE)
_FULL_STOP = re.compile(r"(?:(?<=\w\w)|(?<=[^\w\s.]))\.+(?=\s|$)|(?<=[^\W\d]{2})\.(?=[^\W\d]{2})")
_ABBREVIATION = re.compile(
    r"(?:^|\W)(?:no|nr|nos|st|ste|mt|dr|mr|mrs|ms|ca|approx|incl|inv|vol|vs|jr|sr|prof)$", re.IGNORECASE
)
"""Words whose full stop ends no text."""
_END = re.compile(r"[;；\n\r\v\f\t|。•·\u2028\u2029]+|[!?！？]+(?=\s|$)")
_BRACKETS = re.compile(r"\([^()\n]*\)|\[[^\[\]\n]*\]")
_CONJUNCTIONS = r"and\s*/\s*or|as\s+well\s+as|and|or|plus|und|oder|sowie|et|ou"
_BEFORE, _AFTER = r"(?:(?<=[^\W\d]{2})|(?<=[\d)\ue000-\uf8ff]))", r"(?=[^\W\d]{2}|[(\ue000-\uf8ff])"
"""Words with "/" or "&" between them: "vase/teapot", and not "w/ lid", "1/2" or "AT&T"."""
_JOINT = re.compile(
    # A comma between digits is a decimal one.
    rf"\s*(?:(?<!\d)[,，、]|[,，、](?!\d)|{_BEFORE}[/／\\&＆+]{_AFTER}|(?<=\s)[/／\\&＆+](?=\s)|(?<=\s)[-–—](?=\s)"
    rf"|(?<=\s)(?:{_CONJUNCTIONS})(?=\s))\s*",
    re.IGNORECASE,
)
_LEFT_OVER = re.compile(rf"^(?:(?:{_CONJUNCTIONS})\s+|[\s,.&/+])+|[\s,.&/+]+$|\s+(?:{_CONJUNCTIONS})$", re.IGNORECASE)
_CONTINUED = re.compile(
    r"(?:with|without|of|in|on|upon|inside|within|from|for|by|at|near|under|behind|beside|next to|between|left of"
    r"|right of|to the|made|showing|depicting|that|which|who|whose)\s",
    re.IGNORECASE,
)
"""How a text begins that belongs to the one before: "a vase, with two handles"."""
_COMPLEMENT = re.compile(r"\s(?:with|without|of|from|for|showing|depicting)\s", re.IGNORECASE)
_BETWEEN = re.compile(r"\sbetween\s", re.IGNORECASE)
_FIXED_PHRASES = (
    "arts and crafts", "pen and ink", "rock and roll", "skull and crossbones", "stars and stripes", "tongue and groove",
    "wattle and daub", "horse and rider", "mother and child", "madonna and child", "virgin and child", "adam and eve",
    "castor and pollux", "cupid and psyche", "romulus and remus", "venus and cupid", "victoria and albert",
)  # fmt: skip
"""Phrases beside those of the vocabulary: styles, and what works of art show."""
_ARTICLES = frozenset({"a", "an", "the", "very"})


@dataclass
class _Part:
    """A text, and what stands between it and the one before: empty for the first, and where a sentence ends."""

    text: str
    joint: str


def split_texts(prompt: str) -> list[str]:
    """Return the texts of a prompt that names one or several objects.

    Texts are separated by semicolons, new lines, tabs, full stops, commas, slashes, ``&``, ``+``, dashes between
    spaces, and by *and* or *or* in English, German or French. They are not where a phrase of the vocabulary holds the
    separator ("salt and pepper shaker"), where it joins adjectives ("a blue and white vase") or what is said of one
    object ("a vase, with two handles"), in numbers and abbreviations, and in quotation marks, which are removed.

    Returns
    -------
    list of str
        Different texts without surrounding space, in their order; upper and lower case count as equal. Empty if there
        is none.
    """
    kept: list[str] = []

    def keep(found: re.Match[str]) -> str:
        kept.append(found[0])
        return chr(_FIRST_KEPT + len(kept) - 1)

    # Private-use characters stand for what is not split, so those of the prompt are removed.
    text = _PRIVATE.sub("", prompt)
    text = _QUOTED.sub(keep, text)
    n_quoted = len(kept)
    text = _LIST_MARK.sub("\n", text)
    text = _FULL_STOP.sub(lambda stop: stop[0] if _ABBREVIATION.search(text, 0, stop.start()) else ";", text)
    text = _BRACKETS.sub(keep, text)
    text = _known_phrases().sub(keep, text)
    texts: dict[str, str] = {}
    for sentence in _END.split(text):
        for part in _joined(_parts(sentence)):
            for one in _restored(part, kept, n_quoted):
                texts.setdefault(one.casefold(), one)
    return list(texts.values())


_FIRST_KEPT = 0xE000
_PRIVATE = re.compile("[\ue000-\uf8ff]")


@functools.cache
def _known_phrases() -> re.Pattern[str]:
    """Return a pattern of the vocabulary's phrases that hold a separator, in singular and plural."""
    phrases = [*(word for word in word_list().classes_of_word if _JOINT.search(word)), *_FIXED_PHRASES]
    words = ([re.escape(word) for word in phrase.split()] for phrase in sorted(phrases, key=len, reverse=True))
    forms = (r"\s+".join(r"(?:and|&|＆|'?n')" if word == "and" else rf"{word}s?" for word in each) for each in words)
    return re.compile(rf"\b(?:{'|'.join(forms)})\b", re.IGNORECASE)


def _parts(sentence: str) -> list[_Part]:
    parts: list[_Part] = []
    start, joint = 0, ""
    for found in [*_JOINT.finditer(sentence), None]:
        text = sentence[start : found.start() if found else len(sentence)]
        if _LEFT_OVER.sub("", text.strip()):
            parts.append(_Part(text.strip(), joint if parts else ""))
            joint = ""
        if found:
            joint, start = joint + found[0], found.end()
    return parts


def _joined(parts: Sequence[_Part]) -> list[str]:
    """Return the texts of parts, of which those that say something of one object are put together again."""
    texts: list[str] = []
    waiting = ""  # adjectives whose noun comes
    for number, part in enumerate(parts):
        if texts and not waiting and _belongs(part, texts[-1]):
            texts[-1] += part.joint + part.text
        elif _is_adjective(part.text):
            if number + 1 < len(parts):
                waiting += (part.joint if waiting else "") + part.text
            elif texts and not waiting:
                texts[-1] += part.joint + part.text
            else:
                texts.append(waiting + (part.joint if waiting else "") + part.text)
        else:
            texts.append(waiting + (part.joint if waiting else "") + part.text)
            waiting = ""
    return texts


def _belongs(part: _Part, before: str) -> bool:
    """Return whether a part says something of the object of the text before it."""
    if _CONTINUED.match(f"{part.text} "):
        return True
    if not re.search(r"\w|&", part.joint):
        return False
    if (between := list(_BETWEEN.finditer(before))) and not _JOINT.search(before, between[-1].end()):
        return True
    return bool(_COMPLEMENT.search(before)) and not word_list().classes_of(part.text) and not _PRIVATE.search(part.text)


def _is_adjective(text: str) -> bool:
    words = [word for word in normalised(text).split() if word not in _ARTICLES]
    return bool(words) and not _PRIVATE.search(text) and all(one in adjectives() for one in words)


def _restored(part: str, kept: Sequence[str], n_quoted: int) -> list[str]:
    """Return the texts of a part: those in quotation marks each on its own, where it holds nothing else."""
    marks = [ord(character) - _FIRST_KEPT for character in part if _PRIVATE.match(character)]
    if marks and max(marks) < n_quoted and not _PRIVATE.sub("", part).strip():
        return [text for mark in marks if normalised(text := kept[mark][1:-1].strip())]
    text = _PRIVATE.sub(lambda mark: kept[ord(mark[0]) - _FIRST_KEPT], part)
    text = " ".join(_LEFT_OVER.sub("", text).split())
    return [text] if normalised(text) else []


def split_list(text: str) -> list[str]:
    """Return the names that semicolons separate, without blanks around them and without empty ones."""
    return [name.strip() for name in text.split(";") if name.strip()]


def join_texts(texts: Sequence[str]) -> str:
    """Return a prompt that `split_texts` takes apart into `texts`.

    Parameters
    ----------
    texts : sequence of str
        As returned by `split_texts`.
    """
    return ";".join(text if split_texts(text) == [text] else _quoted(text) for text in texts)


def _quoted(text: str) -> str:
    fitting = (pair for pair in _QUOTES if not set(pair) & set(text))
    pair = next(fitting, _QUOTES[0])
    return f"{pair[0]}{text}{pair[1]}"
