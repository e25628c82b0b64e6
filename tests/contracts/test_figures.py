"""Every figure that README.md and docs tell says whether it is in sample or a test, and how it was made."""

from __future__ import annotations

import re

import pytest

from engine.quality.evaluation.settings import IN_SAMPLE_SCENES
from tests.conftest import ROOT

from .test_constants import SETS

HEADING = "## How good, how long"
MOST_FIGURES = 12
"""Rows of README's table at most: more are not read."""

MARKS = ("in sample", "test")
DOCUMENTS = (
    "segmentation.md",
    "text_prompts.md",
    "error_vs_time.md",
    "training_on_cards.md",
    "detail.md",
    "rasterizer_speed.md",
)
"""Documents with measured quality or speed in `docs`."""

_MARK = re.compile(r"\*+(in sample|test)\*+", re.IGNORECASE)
_COMMAND = re.compile(r"^\s*`{0,3}\s*(python -m|make) \S+|`(python -m|make) [^`]+`", re.MULTILINE)
_LINK = re.compile(r"\]\((?!https?:)([^)#]+)")
_NOT_MEASURED = ("What the columns mean",)


def section_of(text: str, heading: str) -> str:
    """Return the text below a heading, up to the next one of its level."""
    return text.split(f"\n{heading}\n", 1)[1].split("\n## ", 1)[0]


def table_rows(text: str) -> list[list[str]]:
    """Return the cells of the rows of the first table, without its header."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in lines[2:]]


def problems_of_readme(text: str, read: dict[str, str]) -> list[str]:
    """Return what is wrong with README's figures; `read` has the text of each linked file that exists."""
    section = section_of(text, HEADING)
    header = [cell.strip() for cell in next(line for line in section.splitlines() if line.startswith("|")).split("|")]
    if "mark" not in header:
        return ["the table has no column `mark`"]
    column = header.index("mark") - 1
    rows = table_rows(section)
    found = [f"{len(rows)} figures, more than {MOST_FIGURES}"] if len(rows) > MOST_FIGURES else []
    if not rows:
        found.append("no figure")
    for row in rows:
        links = [link for cell in row for link in _LINK.findall(cell)]
        if column >= len(row) or row[column].strip("*") not in MARKS:
            found.append(f"{row[0]}: not marked {' or '.join(MARKS)}")
        if not any(_COMMAND.search(read.get(link, "")) for link in links):
            found.append(f"{row[0]}: no link to a file with the command that makes the figure")
    return found


def unmarked_sections(text: str) -> list[str]:
    """Return the headings of a document whose section has a table and no mark; above the first one, the title."""
    parts = re.split(r"^(#{1,2} .*)$", text, flags=re.MULTILINE)
    sections = list(zip(parts[1::2], parts[2::2], strict=True))
    return [
        heading
        for heading, body in sections
        if re.search(r"^\|", body, re.MULTILINE)
        and heading.lstrip("# ") not in _NOT_MEASURED
        and not _MARK.search(body)
    ]


def test_readme_tells_few_figures_each_marked_and_with_its_command() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    links = {link for row in table_rows(section_of(text, HEADING)) for cell in row for link in _LINK.findall(cell)}
    read = {link: (ROOT / link).read_text(encoding="utf-8") for link in links if (ROOT / link).is_file()}
    assert problems_of_readme(text, read) == []


@pytest.mark.parametrize("document", DOCUMENTS)
def test_every_table_of_figures_is_marked(document: str) -> None:
    assert unmarked_sections((ROOT / "docs" / document).read_text(encoding="utf-8")) == []


def test_rooms_that_values_may_be_chosen_on_are_told_as_in_sample() -> None:
    rooms = {name for name in SETS if name.endswith("_room") or name.startswith("room_")}
    assert set(IN_SAMPLE_SCENES) == rooms


README = """# Title

## How good, how long

| what | data | mark | result | details |
| --- | --- | --- | ---: | --- |
{}

## Next

| other | table |
| --- | --- |
| 1 | 2 |
"""
GOOD = "| IoU | museum room | in sample | 93.6 % | [table](docs/a.md) |"
READ = {"docs/a.md": "# A\n\n```\npython -m engine evaluate x\n```\n", "docs/b.md": "# B\n\nno command\n"}


def test_right_figures_are_accepted() -> None:
    rows = [GOOD, GOOD.replace("in sample", "*test*"), GOOD.replace("museum room", "test rooms")]
    assert problems_of_readme(README.format("\n".join(rows)), READ) == []
    assert problems_of_readme(README.format("\n".join([GOOD] * MOST_FIGURES)), READ) == []


@pytest.mark.parametrize(
    "rows",
    [
        [GOOD.replace("in sample", "")],
        [GOOD.replace("in sample", "held out")],
        [GOOD, GOOD.replace("in sample", "?")],
        [GOOD.replace("[table](docs/a.md)", "measured")],
        [GOOD.replace("docs/a.md", "docs/b.md")],
        [GOOD.replace("docs/a.md", "docs/missing.md")],
        [GOOD.replace("docs/a.md", "https://example.org/a.md")],
        ["| IoU | museum room |"],
        [GOOD] * (MOST_FIGURES + 1),
        [],
    ],
    ids=["no mark", "other mark", "second row", "no link", "no command", "missing file", "web page", "short row",
         "too many", "none"],
)  # fmt: skip
def test_wrong_figure_is_found(rows: list[str]) -> None:
    assert problems_of_readme(README.format("\n".join(rows)), READ) != []


def test_table_without_marks_is_found() -> None:
    assert problems_of_readme(README.format(GOOD).replace("| mark |", "| kind |"), READ) != []


def test_table_without_a_mark_in_its_section_is_found() -> None:
    text = "# Title\n\n**In sample**: x.\n\n## One\n\n{}| a |\n| --- |\n\n## What the columns mean\n\n| b |\n"
    assert unmarked_sections(text.format("")) == ["## One"]
    assert unmarked_sections(text.format("**Test**: none was chosen here.\n\n")) == []
    assert unmarked_sections("# Title\n\n| a |\n") == ["# Title"]
