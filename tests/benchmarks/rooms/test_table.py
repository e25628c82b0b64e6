"""Tables tell means with standard errors, mark what is in sample, name what is missing, and keep a row of each draw."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import pytest

from benchmarks.rooms.draw_rows import read_rows
from benchmarks.rooms.draws import CHOOSING_ROOMS, Draw, Room, test_seeds
from benchmarks.rooms.results import figures_of, result_file, write_result
from benchmarks.rooms.table import rooms_section, write_tables

from .made_up import measured

FIRST, SECOND = (hashlib.sha1(word).hexdigest() for word in (b"first", b"second"))
DRAWS = (
    Draw(FIRST, "votes in 3D", "2026-01-02", test_seeds(FIRST)),
    Draw(SECOND, "one solve", "2026-03-04", test_seeds(SECOND)),
)
NAME = f"votes in 3D {FIRST[:8]}"


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
        store(tmp_path, FIRST, room, iou=0.80 + 0.01 * number)
    text = rooms_section(tmp_path, DRAWS)
    # Deviation of 0, 1, ... 7 is 2.449 with n - 1; divided by the root of 8: 0.866. Three rooms reach 0.85.
    mask, click, word, find_all = rows(text, "8 choosing (*in sample*)", NAME, "better")
    assert mask == ["83.5 ± 0.9", "73.5 ± 0.9", "37.5 ± 18.3"]
    # Of two clicks one leads to an object, which has the IoU of the mask.
    assert click == ["50.0 ± 0.0", "18.8 ± 9.1", "46.8 ± 0.4", "41.8 ± 0.4"]
    # Of the words 90, 60 and 0, two are found, one of them whole; of two absent things one is refused; 2 of 3 are
    # ranked first.
    assert word == ["66.7 ± 0.0", "33.3 ± 0.0", "50.0 ± 0.0", "50.0 ± 0.0", "66.7 ± 0.0", "1.2 ± 0.0", "3.0"]
    assert find_all == ["50.0 ± 0.0", "18.8 ± 9.1", "46.8 ± 0.4", "3.0 ± 0.0", "25.0 ± 0.0", "3.0 ± 0.0"]
    assert len(rows(text, "8 choosing (*in sample*)", NAME, "paper")) == 3, "paper cannot find all objects"
    assert rows(text, "room_3") == [
        [
            "2",
            "82.0",
            "72.0",
            "0.0",
            "50.0",
            "0.0",
            "46.0",
            "66.7",
            "33.3",
            "50.0",
            "50.0",
            "66.7",
            "50.0",
            "0.0",
            "46.0",
            "3.0",
            "25.0",
            "3.0",
        ]
    ]


def test_missing_rooms_are_named_and_counted(tmp_path: Path) -> None:
    store_all(tmp_path, FIRST, CHOOSING_ROOMS[:6])
    text = rooms_section(tmp_path, DRAWS)
    assert f"Not measured yet with {NAME}: room_7, room_8, so they are in no mean." in text
    assert rows(text, "6 of 8 choosing (*in sample*)", NAME, "paper")
    assert "one solve" not in text, "a draw without a measured room has no rows"


def test_without_any_result_no_table_is_shown(tmp_path: Path) -> None:
    text = rooms_section(tmp_path, DRAWS)
    assert "No room is measured yet." in text and "| rooms |" not in text


def test_each_draw_stands_on_its_own_test_rooms(tmp_path: Path) -> None:
    for draw, iou in zip(DRAWS, (0.7, 0.8), strict=True):
        store_all(tmp_path, draw.commit, draw.test_rooms, iou=iou)
    text = rooms_section(tmp_path, DRAWS)
    found = {cells[0]: cells[2] for cells in rows(text, "5 test (*test*)") if cells[1] == "better" and len(cells) == 5}
    assert found == {NAME: "70.0 ± 0.0", f"one solve {SECOND[:8]}": "80.0 ± 0.0"}
    assert "Not measured yet" not in text


def test_rooms_with_models_have_rows_of_their_own(tmp_path: Path) -> None:
    store_all(tmp_path, FIRST, DRAWS[0].test_rooms, iou=0.7)
    store_all(tmp_path, FIRST, DRAWS[0].model_rooms[:3], iou=0.9)
    text = rooms_section(tmp_path, DRAWS)
    assert rows(text, "5 test (*test*)", NAME, "better")[0][0] == "70.0 ± 0.0"
    assert rows(text, "3 of 5 of models (*test*)", NAME, "better")[0][0] == "90.0 ± 0.0"


def test_what_was_not_measured_is_a_dash_and_its_rooms_are_counted(tmp_path: Path) -> None:
    store_all(tmp_path, FIRST, CHOOSING_ROOMS[:2])
    store_all(tmp_path, FIRST, CHOOSING_ROOMS[2:], psnr=None, whole=False)
    text = rooms_section(tmp_path, DRAWS)
    assert rows(text, "8 choosing (*in sample*)", NAME)[-1][-2:] == ["25.0 ± 0.0 (2 rooms)", "3.0 ± 0.0 (2 rooms)"]
    assert rows(text, "room_5")[0][-2:] == ["-", "-"]


def test_different_renderings_of_a_room_are_told(tmp_path: Path) -> None:
    store(tmp_path, FIRST, CHOOSING_ROOMS[0])
    store(tmp_path, SECOND, CHOOSING_ROOMS[0], pictures="other")
    assert "different renderings of room_1." in rooms_section(tmp_path, DRAWS)
    store(tmp_path, SECOND, CHOOSING_ROOMS[0])
    assert "different renderings" not in rooms_section(tmp_path, DRAWS)


def test_the_row_of_a_draw_counts_objects_and_words_of_all_its_rooms(tmp_path: Path) -> None:
    store_all(tmp_path, FIRST, DRAWS[0].test_rooms[:4], iou=0.9)
    assert read_rows(tmp_path, DRAWS) == {}, "a draw that is not measured whole has no row"
    store(tmp_path, FIRST, DRAWS[0].test_rooms[4], iou=0.6)
    row = read_rows(tmp_path, DRAWS)[DRAWS[0]]
    assert (row.objects, row.words, row.absent) == (10, 15, 10)
    assert (row.iou, row.boundary_iou, row.paper_iou, row.whole) == (84.0, 74.0, 84.0, 8)
    assert (row.all_found, row.all_whole, row.all_false) == (5, 4, 15)
    assert (row.words_found, row.words_whole, row.words_ranked, row.refused) == (10, 5, 10, 5)


def test_the_row_of_a_draw_stays_when_the_results_of_its_rooms_are_deleted(tmp_path: Path) -> None:
    document = tmp_path / "segmentation.md"
    store_all(tmp_path, FIRST, DRAWS[0].test_rooms, iou=0.9)
    write_tables(document, tmp_path, DRAWS)
    before = rows(document.read_text(encoding="utf-8"), "2026-01-02")
    for room in DRAWS[0].test_rooms:
        result_file(tmp_path, FIRST, room.name).unlink()
    write_tables(document, tmp_path, DRAWS)
    text = document.read_text(encoding="utf-8")
    assert before and rows(text, "2026-01-02") == before and "No room is measured yet." in text


def test_a_room_without_absent_things_or_ceiling_has_no_such_figures() -> None:
    result = {"rendered": None, **measured()}
    result["ceiling"] = None
    result["text"]["paper"]["absent"] = []
    figures = figures_of(result, "paper")
    assert figures is not None and figures.ceiling is None and figures.refused is None
    assert figures.minutes is None, "nobody noted how long rendering took"


def test_a_draw_that_measured_no_clicks_has_no_row_of_them(tmp_path: Path) -> None:
    store_all(tmp_path, FIRST, DRAWS[0].test_rooms)
    head = {"seed": 1, "commit": SECOND, "pictures": "same"}
    for room in DRAWS[1].test_rooms:
        result = {**head, "room": room.name, **measured()}
        del result["click"]
        write_result(tmp_path, result)
    clicks = rooms_section(tmp_path, DRAWS).split("**By click**")[1].split("**By word**")[0]
    assert NAME in clicks and "one solve" not in clicks


def test_document_gets_both_sections_once_and_keeps_the_others(tmp_path: Path) -> None:
    store_all(tmp_path, FIRST, CHOOSING_ROOMS)
    document = tmp_path / "segmentation.md"
    document.write_text("# Segmentation\n\n## museum_room\n\nA table.\n", encoding="utf-8")
    for _ in range(2):
        write_tables(document, tmp_path, DRAWS)
    text = document.read_text(encoding="utf-8")
    headings = [line for line in text.splitlines() if line.startswith("## ")]
    assert headings == ["## museum_room", "## Random rooms", "## Random rooms: every draw", "## What the columns mean"]
    assert "A table." in text


@pytest.mark.parametrize("method", ["paper", "better"])
def test_a_method_that_the_result_does_not_have_has_no_figures(method: str) -> None:
    result = measured()
    del result["text"][method]
    assert figures_of(result, method) is None
