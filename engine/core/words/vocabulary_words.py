"""The words of the classes of the offline vocabulary, with heritage words and broader words."""

from __future__ import annotations

import difflib
import functools
import re
import unicodedata
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from ..files import read_text

_HERE = Path(__file__).parent
_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue"})
FOREIGN_FILE = _HERE / "foreign_words.txt"
PICTURE_WORDS_FILE = _HERE / "picture_words.txt"
MADE_CLASSES = range(398, 923)  # chosen on museum_room, store_room
"""Classes of things that people make; those before them are animals, those behind them food, places and plants."""
_ARTICLES = re.compile(r"^(?:a|an|the|some|this|that|my|our)\s+")
_AFTER_NOUN = re.compile(r"\s+(?:of|with|in|on|from|for|by|at|near|under|behind|without|made|showing)\s+.*$")
_AFTER_FOREIGN_NOUN = re.compile(
    r"\s+(?:mit|aus|von|vom|auf|im|in|am|an|bei|für|ohne|unter|neben|en|de|du|des|à|au|aux|avec|sans|sur|dans)\s+.*$"
)
_FOREIGN_ARTICLE = re.compile(r"^(?:der|die|das|den|dem|des|ein|eine|einen|einem|einer|eines|le|la|les|un|une|du)\s+")
_ELISION = re.compile(r"^[ld]['’]")
_BETWEEN_NOUNS = re.compile(r"\s+(?:and|or)\s+")
_MIN_LIKENESS = 0.75  # chosen on prompt_words
"""Smallest ratio of `difflib.SequenceMatcher` of a word and a misspelling of it: one wrong letter of four."""
_LIKENESS_SPREAD = 0.1  # chosen on prompt_words
"""Words whose ratio is this much lower than that of the nearest one are suggested, too."""
_MAX_SUGGESTIONS = 3
_N_COMPARED = 20
"""Nearest words of which the first letters are compared."""


@dataclass(frozen=True)
class ClassWords:
    """The words of one class, the usual one first, and its definition."""

    words: tuple[str, ...]
    definition: str


@dataclass(frozen=True)
class WordList:
    """All words of the offline vocabulary.

    Attributes
    ----------
    classes : tuple of ClassWords
        In the order of the classifier's outputs.
    classes_of_word : dict of str to frozenset of int
        Classes by word, in lower case: words of the classes, heritage words and broader words.
    """

    classes: tuple[ClassWords, ...]
    classes_of_word: dict[str, frozenset[int]]
    foreign: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Words of `classes_of_word` by German and French names for them, as in ``foreign_words.txt``."""

    def classes_of(self, text: str) -> frozenset[int]:
        """Return the classes with a word equal to the text, its singular, or its noun ("a red vase with handles").

        A text of several nouns ("vase and teapot", given in quotation marks) has the classes of each. English words
        come before German and French names. Empty when no word and no name is equal.
        """
        english = self._english_classes(text)
        return english or frozenset().union(*(self.classes_of_word[word] for word in self._translated(text)))

    def english_of(self, text: str) -> tuple[str, ...]:
        """Return the words of the vocabulary for a German or French text; empty for any other one."""
        return () if self._english_classes(text) else self._translated(text)

    def has(self, word: str) -> bool:
        """Return whether a whole text in lower case is a word or, but for accents, a German or French name."""
        return word in self.classes_of_word or _folded(word) in self._folded

    def _translated(self, text: str) -> tuple[str, ...]:
        plain = _without_foreign_article(text)
        words = _AFTER_FOREIGN_NOUN.sub("", plain).split()
        # In French, what describes a thing stands behind it.
        ends = (*_endings(" ".join(words)), *(" ".join(words[:n]) for n in range(len(words) - 1, 0, -1)))
        for phrase in (plain, *ends):
            for form in (*singulars(phrase), phrase.removesuffix("x")):
                if found := self._folded.get(_folded(form)):
                    return found
                if form in self.classes_of_word:
                    return (form,)
        return ()

    @functools.cached_property
    def _folded(self) -> dict[str, tuple[str, ...]]:
        """The foreign names without accents, German ones also with ae, oe and ue."""
        names: dict[str, tuple[str, ...]] = {}
        for name, words in self.foreign.items():
            for form in (_folded(name), _folded(name.lower().translate(_UMLAUTS))):
                names[form] = tuple(dict.fromkeys((*names.get(form, ()), *words)))
        return names

    def _english_classes(self, text: str) -> frozenset[int]:
        whole = normalised(text)
        noun = _AFTER_NOUN.sub("", whole)
        # The longest ending is tried first: "church bell" is a heritage word and must have priority over "bell".
        phrases = [ending for ending in _endings(noun) if _BETWEEN_NOUNS.search(ending)]
        if found := self._first_known([whole, *phrases]):
            return found
        return frozenset().union(*(self._first_known(_endings(one)) for one in _BETWEEN_NOUNS.split(noun)))

    def _first_known(self, texts: Iterable[str]) -> frozenset[int]:
        for text in texts:
            # Words are also joined: "tea pot" is a teapot, not a pot.
            for form in (*singulars(text), *singulars(text.replace(" ", ""))):
                if form in self.classes_of_word:
                    return self.classes_of_word[form]
        return frozenset()

    def misspelt(self, text: str, is_english: Callable[[str], bool]) -> list[str]:
        """Return at most three words that are spelt nearly like the text or its noun, the nearest first.

        None for what has only words that `is_english` knows: those are spelt as they are meant. German and French names
        are among them.
        """
        whole = normalised(text)
        noun = _AFTER_NOUN.sub("", whole)
        wrong = [one for one in (whole, noun, noun.rpartition(" ")[2]) if not all(map(is_english, one.split()))]
        forms = [form for one in wrong for form in singulars(one)]
        return similarly_spelt(forms, [*self.classes_of_word, *self.foreign])


@functools.cache
def word_list() -> WordList:
    """Return the words of the offline vocabulary. Raises `FormatError` when a file of the engine is missing."""
    rows = _read_rows("imagenet_classes.txt")
    classes = tuple(ClassWords(tuple(words.split(", ")), definition) for _, words, definition in rows)
    classes_of_word: dict[str, set[int]] = {}
    for index, entry in enumerate(classes):
        for word in entry.words:
            classes_of_word.setdefault(word.lower(), set()).add(index)
    for word, synonyms in _read_rows("heritage_words.txt"):
        indices = set().union(*(classes_of_word[synonym] for synonym in synonyms.split(", ")))
        classes_of_word.setdefault(word, set()).update(indices)
    for word, spans in _read_rows("broader_words.txt"):
        ends = [span.partition("-") for span in spans.split()]
        classes_of_word[word] = {k for first, _, last in ends for k in range(int(first), int(last or first) + 1)}
    foreign = {name: tuple(words.split("; ")) for name, words in _read_rows(FOREIGN_FILE.name)}
    return WordList(classes, {word: frozenset(indices) for word, indices in classes_of_word.items()}, foreign)


@functools.cache
def picture_words() -> WordList:
    """Return the words that pictures taught, of things that the classes lack; each has a class of its own here.

    Raises `FormatError` as `word_list`.
    """
    rows = [(words.split(", "), names.split("; ")) for words, names, _ in _read_rows(PICTURE_WORDS_FILE.name)]
    numbers = {word: frozenset({number}) for number, (words, _) in enumerate(rows) for word in words}
    foreign: dict[str, tuple[str, ...]] = {name: (words[0],) for words, names in rows for name in names if name}
    return WordList(tuple(ClassWords(tuple(words), "") for words, _ in rows), numbers, foreign)


def pictured(text: str) -> int | None:
    """Return the number of the word that pictures taught for a text; None for any other one.

    The whole text, articles aside, is that word, its plural, or a name of it: a key ring is no key. Words and names of
    the classes that are the same come before it.
    """
    taught, plain, foreign = picture_words(), normalised(text.replace("’", "'")), _without_foreign_article(text)
    for form in (plain, foreign, *singulars(plain), *singulars(foreign), foreign.removesuffix("x")):
        if word_list().has(form):
            return None
        if taught.has(form):
            return min(taught.classes_of(form))
    return None


@functools.cache
def adjectives() -> frozenset[str]:
    """Return words that describe an object and name none. Raises `FormatError` as `word_list`."""
    known = word_list().classes_of_word
    return frozenset(word for (line,) in _read_rows("adjectives.txt") for word in line.split() if word not in known)


def _read_rows(name: str) -> Iterator[list[str]]:
    text = read_text(_HERE / name, advice="Install the engine again.")
    return (line.split("\t") for line in text.splitlines() if line and not line.startswith("#"))


def normalised(text: str) -> str:
    """Return a text in lower case, without article and punctuation; empty when it has no letter and no digit."""
    plain = re.sub(r"[^\w\s'-]", " ", text.lower().replace("&", " and ")).replace("_", " ")
    plain = _ARTICLES.sub("", " ".join(plain.split()))
    return plain if any(character.isalnum() for character in plain) else ""


def similarly_spelt(texts: Iterable[str], words: Iterable[str]) -> list[str]:
    """Return at most three of `words` that one of `texts` may be a misspelling of, the nearest first.

    Parameters
    ----------
    texts : iterable of str
        In lower case.
    words : iterable of str
        Compared in lower case, and returned as they are.
    """
    by_lower = {word.lower(): word for word in words}
    likeness: dict[str, float] = {}
    for text in texts:
        for word in difflib.get_close_matches(text, by_lower, n=_N_COMPARED, cutoff=_MIN_LIKENESS):
            # The first letter is seldom wrong, unless letters changed places: "krug" is no "rug", and "easel" no "eel".
            if abs(len(word) - len(text)) <= 1 and (word[0] == text[0] or sorted(word) == sorted(text)):
                ratio = difflib.SequenceMatcher(None, word, text).ratio()
                likeness[word] = max(ratio, likeness.get(word, 0.0))
    least = max(likeness.values(), default=0.0) - _LIKENESS_SPREAD
    nearest = sorted((word for word in likeness if likeness[word] >= least), key=lambda word: -likeness[word])
    return [by_lower[word] for word in nearest[:_MAX_SUGGESTIONS]]


def _without_foreign_article(text: str) -> str:
    """Return a text as `normalised` does, without a German or French article."""
    return normalised(_ELISION.sub("", _FOREIGN_ARTICLE.sub("", text.strip().lower())).replace("’", "'"))


def _folded(text: str) -> str:
    """Return a text in lower case without accents."""
    parts = unicodedata.normalize("NFKD", text.casefold())
    return "".join(one for one in parts if not unicodedata.combining(one))


def _endings(text: str) -> list[str]:
    """Return the text without its first words, the longest first."""
    words = text.split()
    return [" ".join(words[i:]) for i in range(len(words))]


def singulars(text: str) -> list[str]:
    """Return `text` and the words that it may be the plural of."""
    forms = [text]
    if text.endswith("ies"):
        forms.append(text[:-3] + "y")
    if text.endswith("es"):
        forms.append(text[:-2])
    if text.endswith("s") and not text.endswith("ss"):
        forms.append(text[:-1])
    return forms
