"""Make ``engine/core/words/foreign_words.txt``: German and French names of what the offline vocabulary has words for.

    apt-get download trans-de-en dict-freedict-fra-eng dict-freedict-eng-fra   # and unpack them: dpkg -x FILE FOLDER
    python scripts/foreign_words.py FOLDER/usr/share/trans/de-en FOLDER/usr/share/dictd

The dictionaries are those of the Debian packages trans-de-en 1.9-6 (Ding) and dict-freedict 2022.04.21-1, both under
the GNU GPL, version 2 or later.
"""

from __future__ import annotations

import argparse
import gzip
import json
import re
import sys
from collections import defaultdict
from collections.abc import Container, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from engine.core.words.vocabulary_words import FOREIGN_FILE, WordList, picture_words, singulars, word_list  # noqa: E402
from engine.install.models import locate  # noqa: E402

_NOTES = re.compile(r"\{[^}]*\}|\[[^\]]*\]|\([^)]*\)|/[^/]*/|<[^>]*>")
_GERMAN_NOUN = re.compile(r"\{(?:[mfn](?:,[mfn])*|pl)\}")
_SPECIAL = re.compile(
    r"\[(?:min|slang|coll|ugs|pej|obs|vulg|chem|med|anat|biol|geol|math|comp|fin|jur|naut|electr|techn|mach|railw|agr"
    r"|mil|sport|print|textil|ling|phys|telco|constr|humor|figurative|fig|alt|veraltet)\."
)
"""Senses that curators seldom mean: "Hund" is also a tub, in mines."""
_WORD = re.compile(r"[^\W\d_]{3,}(?:-[^\W\d_]{2,})*")
_LEAST_WEIGHT = 0.5
"""Weight of a translation, relative to the best one of its word, from which on it is kept."""
_MAX_CLASSES = 120
"""Words for more classes are left out: "device" says little."""
_PLAIN_VOWELS = str.maketrans("äöüÄÖÜ", "aouAOU")
_OWN_SENSE = frozenset({"Drachen"})
"""Plurals of what pictures show that are singulars as well: a kite, and dragons."""
_LICENCE = """\
# German and French names of what the vocabulary has words for: the name, then words of the vocabulary, the likeliest
# first. `scripts/foreign_words.py` makes this file, and says of which packages. Both dictionaries are under the GNU
# General Public License, version 2 or later:
# German-English word list of Ding, copyright 1995-2023 Frank Richter, TU Chemnitz, https://dict.tu-chemnitz.de/
# FreeDict French-English and English-French, copyright 1999-2022 its contributors, https://freedict.org/
# A name is here if a dictionary translates it, as a noun, by a word of the vocabulary, and if it is no frequent English
# word, of those that the tokenizer of all-MiniLM-L6-v2 has.
"""

Weights = dict[str, dict[str, float]]
"""Weight of each English word, by foreign word."""


def german(lines: Iterable[str]) -> Weights:
    """Return the nouns of Ding's list with the weights of their translations.

    A line has synonyms, separated by ``;``, of a word and of its forms, separated by ``|``: ``Krug {m}; Kanne {f} |
    Krüge {pl}; Kannen {pl} :: jug; pitcher | jugs; pitchers``. The first of the synonyms weigh most.
    """
    weights: Weights = defaultdict(lambda: defaultdict(float))
    for line in lines:
        left, separator, right = line.rstrip("\n").partition(" :: ")
        if line.startswith("#") or not separator:
            continue
        forms = [one.split("|") for one in (left, right)]
        if len(forms[0]) != len(forms[1]) or not _GERMAN_NOUN.search(forms[0][0]) or _SPECIAL.search(forms[0][0]):
            continue
        for number, (names, words) in enumerate(zip(*forms, strict=True)):
            if number > 0 and "{pl}" not in names:
                continue  # an example, not a form
            for place, name in enumerate(names.split(";")):
                plain = _plain(name)
                if _WORD.fullmatch(plain) and plain[0].isupper():
                    for rank, word in enumerate(words.split(";")):
                        weights[plain][_plain(word).lower()] += 1 / ((1 + place) * (1 + rank))
    return weights


def french(into_english: Iterable[str], from_english: Iterable[str]) -> Weights:
    """Return the nouns of FreeDict's dictionaries with the weights of their translations.

    The text of an entry is ``cruche /kʀyʃ/ <n, fem>``, and then one line for each sense, ``1. jug, pitcher``.
    """
    weights: Weights = defaultdict(lambda: defaultdict(float))
    others: set[str] = set()
    for head, senses in _entries(into_english):
        name = _plain(head)
        if "<n" not in head:
            others.add(name)
        elif _WORD.fullmatch(name):
            for rank, word in enumerate(_plain(one) for sense in senses for one in sense.split(",")):
                weights[name][word.lower()] += 1 / (1 + rank)
    known = {*weights, *others}
    for head, senses in _entries(from_english):
        for rank, name in enumerate(_plain(one) for sense in senses for one in sense.split(",")):
            if name not in known and _WORD.fullmatch(name) and name[0].islower():
                weights[name][_plain(head).lower()] += 1 / (1 + rank)
    return weights


def _entries(lines: Iterable[str]) -> Iterator[tuple[str, list[str]]]:
    head = ""
    senses: list[str] = []
    for line in (one.rstrip("\n") for one in lines):
        if " /" in line and line.rstrip().endswith(("/", ">")):
            if head:
                yield head, senses
            head, senses = line, []
        elif head and line.strip():
            senses.append(re.sub(r"^\s*\d+\.\s*", "", line))
    if head:
        yield head, senses


def _plain(text: str) -> str:
    return " ".join(_NOTES.sub(" ", text.replace("‐", "-")).split())


def rows(all_weights: Iterable[Weights], english: Container[str], known: WordList) -> dict[str, list[str]]:
    """Return the words of the vocabulary by foreign name, the likeliest first; none for words that are `english`."""
    merged: Weights = defaultdict(lambda: defaultdict(float))
    for weights in all_weights:
        for name, words in weights.items():
            for word, weight in words.items():
                if (
                    found := next(
                        (one for one in singulars(word) if 0 < len(known.classes_of_word.get(one, ())) <= _MAX_CLASSES),
                        None,
                    )
                ) is not None:
                    merged[name][found] += weight
                elif weight > 0:
                    merged[name].setdefault("", 0.0)
                    merged[name][""] = max(merged[name][""], weight)
    result = {}
    for name, words in merged.items():
        best = max(words.values())
        kept = [word for word in sorted(words, key=lambda one: -words[one]) if words[word] >= _LEAST_WEIGHT * best]
        # What pictures show is none of the classes: "Schere" is no claw.
        if name in picture_words().foreign or (name not in _OWN_SENSE and _is_plural(name, picture_words().foreign)):
            continue
        # An English word is meant as one: "Gift" is a poison, and "boot" a ship.
        if name.lower() not in english and not known.classes_of(name) and any(kept):
            result[name] = [word for word in kept if word]
    return dict(sorted(result.items(), key=lambda row: (row[0].lower(), row[0])))


def _is_plural(name: str, others: Iterable[str]) -> bool:
    """Return whether a German name is one of the others with an ending of plurals, with or without umlaut."""
    ends = {name.translate(_PLAIN_VOWELS).removesuffix(ending) for ending in ("n", "en", "e", "er")}
    return name[0].isupper() and not ends.isdisjoint(other.translate(_PLAIN_VOWELS) for other in others)


def main() -> None:
    """Write the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("ding", type=Path, help="the word list of trans-de-en")
    parser.add_argument("freedict", type=Path, help="folder with freedict-fra-eng.dict.dz and freedict-eng-fra.dict.dz")
    options = parser.parse_args()
    with options.ding.open(encoding="utf-8") as lines:
        of_german = german(lines)
    tokenizer = json.loads(locate("minilm-tokenizer").read_text(encoding="utf-8"))
    files = (options.freedict / f"freedict-{pair}.dict.dz" for pair in ("fra-eng", "eng-fra"))
    texts = [gzip.decompress(file.read_bytes()).decode("utf-8").splitlines() for file in files]
    found = rows([of_german, french(*texts)], tokenizer["model"]["vocab"], replace(word_list(), foreign={}))
    content = _LICENCE + "".join(f"{name}\t{'; '.join(words)}\n" for name, words in found.items())
    FOREIGN_FILE.write_text(content, encoding="utf-8", newline="\n")
    print(f"{len(found)} names")


if __name__ == "__main__":
    main()
