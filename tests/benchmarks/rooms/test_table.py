"""The table of a draw tells means with standard errors, marks what is in sample, and names what is missing."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import pytest

from benchmarks.rooms.draws import CHOOSING_ROOMS, Draw, Room, test_seeds
from benchmarks.rooms.results import figures_of, write_result
from benchmarks.rooms.table import draw_section, write_tables

from .made_up import measured

BASELINE, BETTER = (hashlib.sha1(word).hexdigest() for word in (b"baseline", b"better"))
DRAWS = (
    Draw(BASELINE, "baseline", "2026-01-02", test_seeds(BASELINE)),
    Draw(BETTER, "votes in 3D", "2026-03-04", test_seeds(BETTER)),
)


def store(root: Path, commit: str, room: Room, *, pictures: str = "same", **given: Any) -> None:
    rendered = {"wall": 60.0, "cpu": 60.0, "whole": True}
    head = {"room": room.name, "seed": room.seed, "commit": commit, "pictures": pictures, "rendered": rendered}
    write_result(root, {**head, **measured(**given)})


def store_all(root: Path, commit: str, rooms: tuple[Room, ...], **given: Any) -> None:
    for room in rooms:
        store(root, commit, room, **given)


def rows(text: str, *beginning: str) -> list[list[str]]:
    """Return the cells of the rows that begin with these cells."""
    lines = [line.strip("|").split("|") for line in text.splitlines() if line.startswith("| ")]
    cells = [[cell.strip() for cell in line] for line in lines]
    return [line[len(beginning) :] for line in cells if line[: len(beginning)] == list(beginning)]


def test_means_and_standard_errors_are_over_rooms(tmp_path: Path) -> None:
    for number, room in enumerate(CHOOSING_ROOMS):
        store(tmp_path, BASELINE, room, iou=0.80 + 0.01 * number)
    text = draw_section(tmp_path, DRAWS[:1], DRAWS[0])
    name = f"baseline {BASELINE[:8]}"
    # Deviation of 0, 1, ... 7 is 2.449 with n - 1; divided by the root of 8: 0.866.
    mask, word, find_all = rows(text, "8 choosing (*in sample*)", name, "better")
    assert mask == ["83.5 ± 0.9", "73.5 ± 0.9"]
    # Of the words 90, 60 and 0, two are found; of two absent things one is refused; 2 of 3 are ranked first.
    assert word == ["66.7 ± 0.0", "50.0 ± 0.0", "50.0 ± 0.0", "66.7 ± 0.0", "1.2 ± 0.0", "3.0"]
    assert find_all == ["50.0 ± 0.0", "46.8 ± 0.4", "3.0 ± 0.0"]
    assert len(rows(text, "8 choosing (*in sample*)", name, "paper")) == 2, "paper cannot find all objects"
    assert rows(text, "8 choosing (*in sample*)", name)[-1] == ["25.0 ± 0.0", "3.0 ± 0.0"]
    assert rows(text, "room_3", name, "better") == [
        ["2", "82.0", "72.0", "66.7", "50.0", "50.0", "66.7", "50.0", "46.0", "3.0", "25.0", "3.0"]
    ]


def test_missing_rooms_are_named_and_counted(tmp_path: Path) -> None:
    store_all(tmp_path, BASELINE, CHOOSING_ROOMS[:6])
    text = draw_section(tmp_path, DRAWS[:1], DRAWS[0])
    assert f"Not measured yet with baseline {BASELINE[:8]}: room_7, room_8, so they are in no mean." in text
    assert rows(text, "6 of 8 choosing (*in sample*)", f"baseline {BASELINE[:8]}", "paper")
    assert f"test_{BASELINE[:8]}_1, test_{BASELINE[:8]}_2" in text
    assert not rows(text, "0 of 5 test (*test*)", f"baseline {BASELINE[:8]}", "paper")


def test_without_any_result_all_rooms_are_named_and_no_table_is_shown(tmp_path: Path) -> None:
    text = draw_section(tmp_path, DRAWS[:1], DRAWS[0])
    assert "room_1, room_2" in text and "By mask**" not in text and "| rooms |" not in text


def test_a_method_stands_beside_the_baseline_on_its_own_test_rooms(tmp_path: Path) -> None:
    for commit, iou in ((BASELINE, 0.7), (BETTER, 0.8)):
        store_all(tmp_path, commit, CHOOSING_ROOMS, iou=iou)
        store_all(tmp_path, commit, DRAWS[1].test_rooms, iou=iou)
    text = draw_section(tmp_path, DRAWS, DRAWS[1])
    found = {cells[0]: cells[2] for cells in rows(text, "5 test (*test*)") if cells[1] == "better" and len(cells) == 4}
    assert found == {f"baseline {BASELINE[:8]}": "70.0 ± 0.0", f"votes in 3D {BETTER[:8]}": "80.0 ± 0.0"}
    assert "Not measured yet" not in text


def test_what_was_not_measured_is_a_dash_and_its_rooms_are_counted(tmp_path: Path) -> None:
    store_all(tmp_path, BASELINE, CHOOSING_ROOMS[:2])
    store_all(tmp_path, BASELINE, CHOOSING_ROOMS[2:], psnr=None, whole=False)
    text = draw_section(tmp_path, DRAWS[:1], DRAWS[0])
    assert rows(text, "8 choosing (*in sample*)", f"baseline {BASELINE[:8]}")[-1] == [
        "25.0 ± 0.0 (2 rooms)",
        "3.0 ± 0.0 (2 rooms)",
    ]
    assert rows(text, "room_5", f"baseline {BASELINE[:8]}", "paper")[0][-2:] == ["-", "-"]


def test_different_renderings_of_a_room_are_told(tmp_path: Path) -> None:
    store(tmp_path, BASELINE, CHOOSING_ROOMS[0])
    store(tmp_path, BETTER, CHOOSING_ROOMS[0], pictures="other")
    assert "different renderings of room_1." in draw_section(tmp_path, DRAWS, DRAWS[1])
    store(tmp_path, BETTER, CHOOSING_ROOMS[0])
    assert "different renderings" not in draw_section(tmp_path, DRAWS, DRAWS[1])


def test_a_room_without_absent_things_or_ceiling_has_no_such_figures() -> None:
    result = {"rendered": None, **measured()}
    result["ceiling"] = None
    result["text"]["paper"]["absent"] = []
    figures = figures_of(result, "paper")
    assert figures is not None and figures.ceiling is None and figures.refused is None
    assert figures.minutes is None, "nobody noted how long rendering took"


def test_document_gets_a_section_for_every_draw_and_keeps_the_others(tmp_path: Path) -> None:
    store_all(tmp_path, BASELINE, CHOOSING_ROOMS)
    document = tmp_path / "segmentation.md"
    document.write_text("# Segmentation\n\n## museum_room\n\nA table.\n", encoding="utf-8")
    for _ in range(2):
        write_tables(document, tmp_path, DRAWS)
    text = document.read_text(encoding="utf-8")
    headings = [line for line in text.splitlines() if line.startswith("## ")]
    assert headings == [
        "## museum_room",
        f"## Random rooms, draw {BASELINE[:8]}: baseline",
        f"## Random rooms, draw {BETTER[:8]}: votes in 3D",
        "## What the columns mean",
    ]
    assert "A table." in text


@pytest.mark.parametrize("method", ["paper", "better"])
def test_a_method_that_the_result_does_not_have_has_no_figures(method: str) -> None:
    result = measured()
    del result["text"][method]
    assert figures_of(result, method) is None
