"""The files of an evaluation: its results and its tables."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from engine.core.files import finite_or_null
from engine.quality.evaluation.results_file import write_results
from engine.quality.evaluation.table import data_of, write_evaluation
from tests.engine.pictures.blob_scene import BlobScene
from tests.engine.quality.evaluation.blob_truth import write_truth


@pytest.mark.parametrize("kind", ["text", "mask", "all"])
def test_results_file_has_rows_and_figures(kind: str, evaluate, blobs: BlobScene, tmp_path: Path) -> None:
    truth = write_truth(blobs, tmp_path / "room" / "truth", absent=("ghost", "unicorn"))
    found = evaluate(truth, prompt_kind=kind, presets=("better",))
    file = tmp_path / "results.json"
    write_results(file, found)
    assert file.stat().st_size < 20_000
    stored = json.loads(file.read_text(encoding="utf-8"))
    assert stored["scene"] == "room" and stored["settings"]["prompt_kind"] == kind
    for name in ("rows", "words"):
        assert stored[name] == [finite_or_null(asdict(one)) for one in getattr(found, name)]
    (figures,) = stored["summary"]
    assert figures["n_asked"] == 3 and figures["method"] == "better"
    # The detector does not know the word "other red ball".
    assert stored["words_ranked_first"] == (2 if kind == "text" else None)


def test_tables_say_whether_they_are_in_sample(evaluate, tmp_path: Path) -> None:
    found = evaluate(presets=("paper",), objects=("blue ball",))
    for title, scene in (("museum_room", "truth"), ("try_7", "store_room"), ("room_8", ""), ("other", "room_1")):
        assert data_of(replace(found, scene=scene), title) == "in sample"
    for title, scene in (("fountain", "fountain"), ("room_9", "room_99")):
        assert data_of(replace(found, scene=scene), title) == "test"
    doc = tmp_path / "table.md"
    write_evaluation(doc, found, title="museum_room", command="a")
    write_evaluation(doc, found, title="fountain", command="b")
    museum, fountain = doc.read_text(encoding="utf-8").split("## ")[1:3]
    assert "**In sample**: constants of the method were chosen on this scene." in museum and "**Test**" not in museum
    assert "**Test**: no constant of the method was chosen on this scene." in fountain
    assert "Isolating looked at none of them, but at the 6 other photos." in fountain


def test_tables_say_that_compared_photos_were_looked_at(evaluate, tmp_path: Path) -> None:
    found = evaluate(presets=("paper",), objects=("blue ball",), views="all")
    write_evaluation(tmp_path / "table.md", found, title="fountain", command="a")
    assert "Isolating looked at all of them and at 0 other photos." in (tmp_path / "table.md").read_text("utf-8")
