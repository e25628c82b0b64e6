"""A search for all objects: what counts for an object, what is ignored, and what is false."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.masks.storage import label_map_path, write_label_map
from engine.objects.found import FoundObject, Levels
from engine.quality.evaluation.results import Evaluation
from engine.quality.evaluation.summary import summarise
from engine.quality.evaluation.table import markdown
from tests.engine.pictures.blob_scene import BLUE, FLOOR, RED, TWIN, BlobScene
from tests.engine.quality.evaluation.blob_truth import NAMES, write_truth


def search_returns(monkeypatch: pytest.MonkeyPatch, *members: np.ndarray) -> list[Any]:
    """Let a search for all objects return these Gaussians; the list tells with which settings it was asked."""
    asked: list[Any] = []

    def search(context: Any) -> list[FoundObject]:
        asked.append(context.settings)
        return [
            FoundObject(Levels((each.astype(np.float32),)), 0.8, name=f"thing {k}") for k, each in enumerate(members)
        ]

    monkeypatch.setattr("engine.quality.evaluation.trained_scene.find_everything", search)
    return asked


def test_every_ball_gets_the_result_that_shows_it(evaluate, project, blobs: BlobScene) -> None:
    for photo, labels in blobs.labels.items():
        write_label_map(label_map_path(project.path / "masks", photo), labels)
    found: Evaluation = evaluate(prompt_kind="all", presets=("paper", "better"))
    assert [(row.object, row.method) for row in found.rows] == [(name, "better") for name in NAMES.values()]
    for row in found.rows:
        assert row.found and row.iou > 0.9 and row.gaussian_iou > 0.9 and row.prompt_photo == "", row
        assert np.isnan(row.seconds) and np.isnan(row.cpu_seconds)
    (figures,), (search,) = summarise(found), found.searches
    assert (figures.n_found, figures.n_asked) == (3, 3) and figures.n_results == len(search.results) >= 3
    assert figures.seconds_median == figures.seconds_worst == search.seconds > 0
    assert sorted(result.object for result in search.results if result.kind == "object") == sorted(NAMES.values())
    assert "| better | 3 of 3 |" in markdown(found)


def test_results_are_sorted_into_objects_ignored_unseen_and_false(
    evaluate, blobs: BlobScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nothing = np.zeros(len(blobs.part), bool)
    sliver = nothing.copy()
    sliver[np.flatnonzero(blobs.part == RED)[:8]] = True
    asked = search_returns(monkeypatch, blobs.part == BLUE, blobs.part == FLOOR, blobs.part == TWIN, nothing, sliver)
    truth = write_truth(blobs, tmp_path / "ignoring", ignored=(TWIN,))
    found = evaluate(truth, prompt_kind="all", presets=("paper", "released", "better"))
    assert len(asked) == 1
    (search,) = found.searches
    kinds = [(result.kind, result.object if result.kind == "object" else "") for result in search.results]
    assert kinds == [("object", "blue ball"), ("false", ""), ("ignored", ""), ("unseen", ""), ("false", "")]
    (figures,) = summarise(found)
    assert (figures.n_results, figures.n_false, figures.n_ignored, figures.n_unseen) == (5, 2, 1, 1)
    # The twin is ignored, so two objects count, of which only the blue one has a result of its own.
    assert [(row.object, row.found) for row in found.rows] == [("red ball", False), ("blue ball", True)]
    red, blue = found.rows
    assert red.iou < 0.5 and figures.iou == pytest.approx((red.iou + blue.iou) / 2)
    table = markdown(found)
    assert "| better | 1 of 2 |" in table and "thing 1 0.80 (false), " in table


def test_a_result_counts_for_one_object_only(
    evaluate, blobs: BlobScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    search_returns(monkeypatch, np.isin(blobs.part, (RED, TWIN)))
    found = evaluate(prompt_kind="all", presets=("better",))
    returned = {row.object: row.returned for row in found.rows}
    assert sorted(returned.values()) == [False, False, True] and not returned["blue ball"]
    missing = next(row for row in found.rows if row.object == "blue ball")
    assert (missing.iou, missing.boundary_iou, missing.remark) == (0.0, 0.0, "No result shows it.")


def test_search_without_results_finds_nothing(evaluate, monkeypatch: pytest.MonkeyPatch) -> None:
    search_returns(monkeypatch)
    (figures,) = summarise(evaluate(prompt_kind="all", presets=("better",)))
    assert (figures.n_found, figures.n_asked, figures.iou, figures.n_results) == (0, 3, 0.0, 0)
