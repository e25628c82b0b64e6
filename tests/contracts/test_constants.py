"""A number that was fitted on data names this data, and none was fitted on data that tests the method.

docs/constants.md explains the tags and the sets. A tag is the comment ``# chosen on SET, SET`` behind a number, on its
line or on the last line of its statement.
"""

from __future__ import annotations

import ast
import functools
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import ROOT

from .sources import nodes

LEAST_TAGS = {"training": 88, "pipeline/planning": 45, "objects/grounding": 17, "objects": 81, "core/words": 3}
"""Packages of the engine that are read, and the tags that each has at least: fitted numbers do not lose theirs."""

SETS = frozenset({
    *(f"room_{number}" for number in range(1, 9)),
    "model_rooms", "more_rooms", "museum_room", "store_room",
    "banana16", "herz_jesus25", "meeting_place9", "sakharov_statue32", "skull66",
    "stability_scenes", "sky_scene", "prompt_words", "pictures",
})  # fmt: skip
"""Data that values may be chosen on; docs/constants.md says what each is. Test rooms and sets that are kept for
evaluation are not among them."""

_START = "chosen on"


@functools.cache
def tags(source: str) -> dict[int, str]:
    """Return the tag in the comment of each line."""
    found = {}
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            for part in token.string.split("#"):
                if re.match(rf"{_START}\b", part.strip()):
                    found[token.start[0]] = part.strip()
    return found


def problem_of(tag: str) -> str | None:
    """Return what is wrong with a tag, None when it is right."""
    names = [name.strip() for name in tag.removeprefix(_START).split(",")]
    unknown = [name for name in names if name not in SETS]
    return f"no value may be chosen on {', '.join(map(repr, unknown))}" if unknown else None


def lines_with_values(source: str) -> set[int]:
    """Return the lines of literals, and the last line of each statement, or header of a block, that has one."""
    lines: set[int] = set()
    for node in nodes(source):
        if isinstance(node, ast.stmt):
            body = getattr(node, "body", None)
            last = max(node.lineno, body[0].lineno - 1) if body else node.end_lineno or node.lineno
            own = [value.lineno for value in ast.walk(node) if isinstance(value, ast.Constant) and value.lineno <= last]
            if own and not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):  # no docstring
                lines |= {*own, last}
    return lines


def problems(source: str) -> list[tuple[int, str]]:
    """Return line and complaint for each wrong tag."""
    places = lines_with_values(source)
    wrong = [(line, what) for line, tag in tags(source).items() if (what := problem_of(tag))]
    return sorted(wrong + [(line, "a tag without a number") for line in tags(source) if line not in places])


def modules() -> Iterator[tuple[str, str, Path]]:
    """Yield the package, the source and the path of every module that is read."""
    for package in LEAST_TAGS:
        for path in sorted((ROOT / "engine" / package).rglob("*.py")):
            yield package, path.read_text(encoding="utf-8"), path


def test_fitted_numbers_name_the_data_that_they_were_fitted_on() -> None:
    found = [
        f"{path.relative_to(ROOT)}:{line}: {what}" for _, source, path in modules() for line, what in problems(source)
    ]
    assert found == [], f"{len(found)} places, see docs/constants.md:\n" + "\n".join(found)


def test_fitted_numbers_keep_their_tags() -> None:
    seen = dict.fromkeys(LEAST_TAGS, 0)
    for package, source, _ in modules():
        seen[package] += len(tags(source))
    assert {package: n for package, n in seen.items() if n < LEAST_TAGS[package]} == {}, f"of {seen}"


def test_document_says_what_each_set_is() -> None:
    text = (ROOT / "docs" / "constants.md").read_text(encoding="utf-8")
    named = {name for name in SETS if not name.startswith("room_")} | {"room_1", "room_8"}
    assert {name for name in named if name not in text} == set()


PLAIN = "_LIMIT = 0.45  # {}\n"
IN_SETTINGS = "class SegmentSettings:\n    least_score: float = 0.45  # {}\n"


@pytest.mark.parametrize("module", [PLAIN, IN_SETTINGS], ids=["constant", "setting"])
@pytest.mark.parametrize(
    "tag",
    [
        "chosen on test_room_1",
        "chosen on test_room",
        "chosen on museum_room, test_room_5",
        "chosen on room_9",
        "chosen on 1734",
        "chosen on seed 1734",
        "chosen on gallery",
        "chosen on fountain",
        "chosen on toy",
        "chosen on store_room, fountain",
        "chosen on Museum_Room",
        "chosen on",
        "chosen on museum_room,",
        "chosen on museum_room; chosen on gallery",
        "chosen on museum_room, roughly",
    ],
)
def test_wrong_tag_is_found(module: str, tag: str) -> None:
    assert [place for place, _ in problems(module.format(tag))] == [module.count("\n")]
    assert problems(module.format("chosen on museum_room")) == []


@pytest.mark.parametrize(
    "comment",
    [
        "chosen on museum_room",
        "chosen on room_1, room_8, store_room",
        "chosen on museum_room  # noqa: N802",
        "type: ignore[assignment]  # chosen on sakharov_statue32",
        "Kerbl et al. 2023",
    ],
)
def test_right_tag_and_other_comments_are_accepted(comment: str) -> None:
    assert problems(PLAIN.format(comment)) == []


@pytest.mark.parametrize(
    ("module", "setting"),
    [
        ("objects/settings", "strictness"),
        ("training/settings", "cooldown"),
        ("objects/grounding/grounding_dino", "max_overlap"),
    ],
)
def test_test_room_planted_in_the_settings_is_found(module: str, setting: str) -> None:
    source = (ROOT / "engine" / f"{module}.py").read_text(encoding="utf-8")
    line = next(line for line in source.splitlines() if line.strip().startswith(f"{setting}: float = "))
    broken = line.split("#")[0] + "# chosen on test_room_2"
    assert [place for place, _ in problems(source.replace(line, broken))] == [source.splitlines().index(line) + 1]


@pytest.mark.parametrize(
    "source",
    [
        "LIMITS = (\n    1.0,\n    2.0,\n)  # chosen on museum_room",
        "LIMITS = (\n    1.0,  # chosen on museum_room\n    2.0,\n)",
        "def f(\n    x=1,\n    y=2,\n) -> None:  # chosen on museum_room\n    pass",
        "def f():\n    limit = 3  # chosen on museum_room",
        "class A:\n    growth: str = 'opacity'  # chosen on museum_room",
    ],
)
def test_tag_stands_behind_a_value_or_at_the_end_of_its_statement(source: str) -> None:
    assert problems(source + "\n") == []


@pytest.mark.parametrize(
    "source",
    [
        "LIMIT = OTHER  # chosen on museum_room",
        "# chosen on museum_room\nLIMIT = 3",
        "LIMIT = 3\n# chosen on museum_room",
        '"""A limit."""  # chosen on museum_room',
    ],
)
def test_tag_without_a_number_is_found(source: str) -> None:
    assert [what for _, what in problems(source + "\n")] == ["a tag without a number"]


def test_text_is_no_tag() -> None:
    assert problems("LIMIT = (3, '# chosen on gallery')\n") == []
