"""List the texts that users see in Blender, on the page and in reports, and those that have no translation yet.

example: python scripts/extract_texts.py --language de
"""

from __future__ import annotations

import argparse
import ast
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PLACES = (
    "gaussian_heritage_addon/**/*.py",
    "operators/**/*.py",
    "engine/delivery/report/*.py",
    "engine/delivery/packages/page.py",
    "engine/delivery/records/unit.py",
    "engine/serve/**/*.py",
    "engine/core/stage_names.py",
    "engine/rasterizer/devices.py",
    "engine/training/settings.py",
    "engine/formats/table.py",
    "engine/install/models/catalogue.py",
)
"""Modules with texts that users see."""
ANSWERS = "engine/serve/**/*.py"
"""Modules whose errors the page shows; those that state a value stay English."""
SENTENCES = "engine/[!q]*/**/*.py"
"""Modules that tell how far they are and what they left out; all but those of `quality`, which is for developers."""
PAGE = "engine/serve/page/src/**/*.js"
LANGUAGES = {file.stem: file for file in (ROOT / "engine" / "core" / "language" / "texts").glob("*.json")}
_SHOWN = ("text", "title", "confirm_text", "placeholder")
"""Arguments of layouts and dialogs that Blender translates."""
_PARTS_OF_AN_ITEM = 5
_TRANSLATING = {
    "t": 0,
    "translated": 0,
    "pgettext_n": 0,
    "draw_text": 1,
    "TrainingPreset": 1,
    "Format": 1,
    "ModelParts": 0,
}
"""Functions whose text at this position among their arguments is translated."""
_CONSTANTS = {"_LABEL": "label", "_DESCRIPTION": "tooltip", "_SENTENCE": "label"}
"""Ends of the names of constants that are translated where they are shown."""
_TABLE = "_NAMES"
"""End of the names of dictionaries whose values are translated where they are shown."""
_SAYING = {"LeftOut": (0, 1), "Progress": (3,), "tell": (1,), "report": (1,), "_emit_progress": (0,)}
"""Functions that say something to the user by the arguments at these positions, or `message`."""
_SAID = ("what", "why", "saved")
"""Keys of dictionaries whose values are said."""
_CALL = re.compile(r"\b(t|plural)\(")
_STRING = re.compile(r'"(?:[^"\\]|\\.)*"')
"""On the page, the first argument of `t` has a text or several to choose from; `plural` has two, after the number."""
_DESCRIPTION = 4
"""Position of the description of a format."""


def texts_of_script(source: str) -> Iterator[str]:
    """Yield each text that a module of the page translates."""
    for call in _CALL.finditer(source):
        depth, place = 1, call.end()
        while depth and not (depth == 1 and source[place] == "," and call[1] == "t"):
            if string := _STRING.match(source, place):
                yield from filter(_has_letters, [json.loads(string[0])])
                place = string.end()
                continue
            depth += {"(": 1, "[": 1, ")": -1, "]": -1}.get(source[place], 0)
            place += 1


def texts_of(source: str) -> Iterator[tuple[str, str]]:
    """Yield the kind, ``"label"`` or ``"tooltip"``, and the text of each text of a module in Python."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ClassDef):
            yield from _of_class(node)
        elif isinstance(node, ast.Tuple) and len(node.elts) == _PARTS_OF_AN_ITEM:
            yield from _of_item(node)
        elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            for ending, kind in _CONSTANTS.items():
                if node.targets[0].id.endswith(ending):
                    yield from _constant(kind, node.value)
            if node.targets[0].id.endswith(_TABLE) and isinstance(node.value, ast.Dict):
                for value in node.value.values:
                    yield from _constant("label", value)
        elif isinstance(node, ast.Call):
            called = node.func.id if isinstance(node.func, ast.Name) else ""
            is_offered = all(keyword.arg != "offered" for keyword in node.keywords)
            # A format without a writer is not in Blender's menus.
            writes = len(node.args) > _DESCRIPTION + 1 or any(keyword.arg == "write_mesh" for keyword in node.keywords)
            is_offered = is_offered and (called != "Format" or writes)
            if called in _TRANSLATING and len(node.args) > _TRANSLATING[called] and is_offered:
                yield from _constant("label", node.args[_TRANSLATING[called]])
                if called == "TrainingPreset":
                    # Its name is the label of the choice.
                    yield from ((kind, text.capitalize()) for kind, text in _constant("label", node.args[0]))
                elif called == "Format":
                    yield from _constant("tooltip", node.args[_DESCRIPTION])
            is_property = called.endswith("Property")
            for keyword in node.keywords:
                if is_property and keyword.arg in ("name", "description"):
                    yield from _constant("label" if keyword.arg == "name" else "tooltip", keyword.value)
                elif is_property and keyword.arg == "items" and isinstance(keyword.value, ast.List):
                    for item in keyword.value.elts:
                        if isinstance(item, ast.Tuple):
                            yield from _constant("label", item.elts[1])
                            yield from _constant("tooltip", item.elts[2])
                elif keyword.arg in _SHOWN:
                    yield from _constant("label", keyword.value)


def answers_of(source: str) -> Iterator[str]:
    """Yield the sentence of each error of a module that states no value."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            for argument in node.exc.args:
                yield from (text for _, text in _constant("label", argument))


def sentences_of(source: str) -> Iterator[str]:
    """Yield what a module of the engine says, with ``{}`` in the places of values."""
    for node in ast.walk(ast.parse(source)):
        said: list[ast.expr] = []
        if isinstance(node, ast.Call):
            called = node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")
            if called in _SAYING:
                said = [node.args[place] for place in _SAYING[called] if place < len(node.args)]
                said += [keyword.value for keyword in node.keywords if keyword.arg == "message"]
        elif isinstance(node, ast.Dict):
            pairs = zip(node.keys, node.values, strict=True)
            said = [value for key, value in pairs if isinstance(key, ast.Constant) and key.value in _SAID]
        for expression in said:
            yield from filter(_has_letters, _forms(expression))


def _forms(node: ast.expr) -> Iterator[str]:
    if isinstance(node, ast.IfExp):
        yield from _forms(node.body)
        yield from _forms(node.orelse)
    elif isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    elif isinstance(node, ast.JoinedStr):
        yield "".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values)


def _of_class(node: ast.ClassDef) -> Iterator[tuple[str, str]]:
    labels = [
        statement.value
        for statement in node.body
        if isinstance(statement, ast.Assign)
        and any(isinstance(target, ast.Name) and target.id == "bl_label" for target in statement.targets)
    ]
    for label in labels:
        yield from _constant("label", label)
    description = ast.get_docstring(node)
    if labels and "_OT_" in node.name and description:
        yield "tooltip", description


def _of_item(node: ast.Tuple) -> Iterator[tuple[str, str]]:
    """Yield the texts of an item of a choice whose items a function returns: name, label, tooltip, icon and number."""
    kinds = [type(part.value) if isinstance(part, ast.Constant) else object for part in node.elts]
    if kinds == [str, str, str, str, int]:
        yield from _constant("label", node.elts[1])
        yield from _constant("tooltip", node.elts[2])


def _constant(kind: str, node: ast.expr) -> Iterator[tuple[str, str]]:
    if isinstance(node, ast.IfExp):
        yield from _constant(kind, node.body)
        yield from _constant(kind, node.orelse)
    elif isinstance(node, ast.BoolOp):
        for value in node.values:
            yield from _constant(kind, value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, str) and _has_letters(node.value):
        yield kind, node.value


def _has_letters(text: str) -> bool:
    return any(map(str.isalpha, text))


def all_texts() -> dict[str, str]:
    """Return all texts that users see, with their kinds."""
    found: dict[str, str] = {}
    for place in PLACES:
        for file in sorted(ROOT.glob(place)):
            for kind, text in texts_of(file.read_text(encoding="utf-8")):
                found.setdefault(text, kind)
    for file in sorted(ROOT.glob(ANSWERS)):
        for text in answers_of(file.read_text(encoding="utf-8")):
            found.setdefault(text, "label")
    for file in sorted(ROOT.glob(PAGE)):
        for text in texts_of_script(file.read_text(encoding="utf-8")):
            found.setdefault(text, "label")
    return found


def all_sentences() -> set[str]:
    """Return all that the engine says while it works, and of what it left out."""
    return {text for file in sorted(ROOT.glob(SENTENCES)) for text in sentences_of(file.read_text(encoding="utf-8"))}


def translated(file: Path, part: str = "texts") -> dict[str, str]:
    """Return the texts, or the sentences, of a language."""
    texts: dict[str, str] = json.loads(file.read_text(encoding="utf-8"))[part]
    return texts


def main() -> int:
    """Print what the language's file lacks, as lines for it, and what it has that is not used any more."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--language", choices=sorted(LANGUAGES), default="de")
    options = parser.parse_args()
    for part, used in (("texts", set(all_texts())), ("sentences", all_sentences())):
        known = set(translated(LANGUAGES[options.language], part))
        print(f"# {part} without a translation: {len(used - known)}")
        for text in sorted(used - known):
            print(f'  {json.dumps(text, ensure_ascii=False)}: "",')
        print(f"# translated {part} that are not used any more: {len(known - used)}")
        for text in sorted(known - used):
            print(f"  {json.dumps(text, ensure_ascii=False)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
