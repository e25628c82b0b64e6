"""Objects of the blob scene, whose truth is known, come out with the figures that they must have."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from engine.core.errors import Cancelled, MaskError, SettingsError
from engine.core.events import Progress, Warned, never_stop
from engine.objects.segment import find_objects
from engine.objects.settings import BETTER, PAPER, PRESETS
from engine.pictures import visible_masks
from engine.pictures.render import render_view
from engine.pictures.scene import Scene
from engine.project.folder import ProjectFolder
from engine.project.objects import list_objects
from engine.quality.evaluation.gaussian_truth import UNSEEN, gaussian_iou, gaussian_truth
from engine.quality.evaluation.ground_truth import read_ground_truth
from engine.quality.evaluation.results import mean_of
from engine.quality.evaluation.settings import EvaluationSettings, methods_of
from engine.quality.evaluation.table import markdown, write_evaluation
from tests.engine.pictures.blob_scene import BLUE, FLOOR, RED, TWIN, BlobScene
from tests.engine.quality.evaluation.blob_truth import HELD_OUT, NAMES, held_out, write_truth


@pytest.mark.parametrize("prompt_kind", ["mask", "click"])
def test_perfect_scene_scores_high_in_photos_not_trained_on(evaluate, project: ProjectFolder, prompt_kind: str) -> None:
    found = evaluate(prompt_kind=prompt_kind)
    assert found.photos == HELD_OUT and found.n_trained_on == 0 and found.layout == "museum"
    assert [(row.object, row.method) for row in found.rows] == [
        (o, w) for o in NAMES.values() for w in ("paper", "better")
    ]
    for row in found.rows:
        assert row.found and row.returned and row.iou > 0.93 and row.boundary_iou > 0.85, row
        assert row.gaussian_iou > 0.93, row
        assert row.holes < 0.06 and row.halo < 0.06 and row.stray == 0.0, row
        # The photos are pictures of these very Gaussians: only the balls' soft rims differ.
        assert row.psnr > 20, row
        assert 1 <= row.n_views <= 2 and row.prompt_photo not in HELD_OUT and row.seconds > 0, row
    assert list_objects(project.path) == []


def test_text_that_finds_nothing_counts_0_and_says_why(evaluate, blobs: BlobScene, tmp_path: Path) -> None:
    names = {BLUE: "blue ball", RED: "unicorn"}
    found = evaluate(write_truth(blobs, tmp_path / "texts", names=names), prompt_kind="text", presets=("paper",))
    ball, unicorn = sorted(found.rows, key=lambda row: row.object)
    assert ball.found and ball.iou > 0.93 and ball.prompt_photo == ""
    assert not unicorn.found and (unicorn.iou, unicorn.boundary_iou, unicorn.holes) == (0.0, 0.0, 1.0)
    assert math.isnan(unicorn.psnr) and math.isnan(unicorn.halo) and unicorn.gaussian_iou == 0.0
    table = markdown(found)
    assert "| unicorn | **refused** |" in table and "'unicorn' is not known" in table
    assert f"| paper | 1 of 2 | {50 * ball.iou:.1f} |" in table


def test_equal_objects_asked_for_by_one_text_get_a_find_each(
    evaluate, blobs: BlobScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def counted(*arguments, **others):  # type: ignore[no-untyped-def]
        asked.append(arguments[1])
        # In the order that the truth does not have them in.
        return find_objects(*arguments, **others)[::-1]

    monkeypatch.setattr("engine.quality.evaluation.trained_scene.find_objects", counted)
    truth = write_truth(blobs, tmp_path / "twins", prompts={RED: "red ball", TWIN: "red ball", BLUE: "blue ball"})
    found = evaluate(truth, prompt_kind="text", presets=("better",))
    assert [row.object for row in found.rows] == list(NAMES.values()) and len(asked) == 2
    for row in found.rows:
        assert row.found and row.returned and row.iou > 0.9 and row.gaussian_iou > 0.9, row
    (only,) = evaluate(truth, prompt_kind="text", presets=("better",), objects=("other red ball",)).rows
    assert only.iou > 0.9 and only.prompt_photo == ""


def test_equal_object_without_a_find_of_its_own_counts_0(
    evaluate, blobs: BlobScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "engine.quality.evaluation.trained_scene.find_objects", lambda *a, **o: find_objects(*a, **o)[:1]
    )
    truth = write_truth(blobs, tmp_path / "twins", prompts={RED: "red ball", TWIN: "red ball", BLUE: "blue ball"})
    rows = evaluate(truth, prompt_kind="text", presets=("better",), objects=("red ball", "other red ball")).rows
    assert sorted(row.returned for row in rows) == [False, True]
    (missing,) = [row for row in rows if not row.returned]
    assert (missing.iou, missing.holes, missing.remark) == (0.0, 1.0, "Fewer objects were found than there are.")


def test_numbers_of_views_are_compared_where_they_make_a_difference(evaluate) -> None:
    found = evaluate(view_counts=(1, 8, 24), objects=("blue ball",))
    assert [row.method for row in found.rows] == ["paper", "better", "better, 1 view", "better, 8 views"]
    one = methods_of(found.settings)[2]
    assert (one.settings.n_vote_views, one.n_views, one.preset) == (1, 1, "better")
    by_text = methods_of(replace(found.settings, prompt_kind="text", presets=("paper",)))
    assert [(method.name, method.settings.n_text_views) for method in by_text] == [
        ("paper", 8), ("paper, 1 view", 1), ("paper, 24 views", 24)
    ]  # fmt: skip


def test_all_views_leave_out_only_the_seeds(evaluate, blobs: BlobScene) -> None:
    found = evaluate(views="all", presets=("paper",), objects=("blue ball",))
    (row,) = found.rows
    shown = [photo for photo, labels in blobs.labels.items() if (labels == BLUE).sum() >= 100]
    assert row.n_views == len(shown) - 1 and row.prompt_photo in shown
    assert len(found.photos) == 8 and found.n_trained_on == 6


def test_ablations_switch_one_ingredient_off_each(evaluate) -> None:
    found = evaluate(ablations=True, objects=("blue ball",))
    assert [row.method for row in found.rows] == [method.name for method in methods_of(found.settings)]
    changed = [method for method in methods_of(found.settings) if method.name not in PRESETS]
    for method in changed:
        differing = [name for name in vars(BETTER) if getattr(method.settings, name) != getattr(BETTER, name)]
        assert len(differing) + bool(method.without) == 1, method
    assert len(changed) == 4
    assert len(methods_of(replace(found.settings, prompt_kind="click"))) == 6
    assert len(methods_of(replace(found.settings, prompt_kind="text"))) == 2
    # No settings of one object matter to a search for all of them.
    searches = methods_of(replace(found.settings, prompt_kind="all", view_counts=(2,)))
    assert [method.name for method in searches] == ["better"]


def test_masks_of_the_evaluation_are_those_that_render_writes(blobs: BlobScene) -> None:
    members = [blobs.part == part for part in (FLOOR, RED, BLUE)] * 7
    camera = blobs.cameras.cameras[3]
    masks = list(visible_masks(Scene(blobs.gaussians), camera, members))
    assert len(masks) == 21
    for mask, those in zip(masks, members, strict=True):
        assert np.array_equal(mask, render_view(blobs.gaussians, camera, what="mask", members=those) > 0)


def test_masks_of_all_photos_tell_what_a_gaussian_belongs_to(blobs: BlobScene, tmp_path: Path) -> None:
    truth = read_ground_truth(write_truth(blobs, tmp_path), list(blobs.labels))
    labels = gaussian_truth(Scene(blobs.gaussians), blobs.cameras, truth, never_stop)
    seen = labels != UNSEEN
    assert 0.5 < seen.mean() < 1
    true = np.array([3, 0, 1, 2])[blobs.part]
    assert (labels[seen] == true[seen]).mean() > 0.95
    assert gaussian_iou(labels == 2, labels, 2) == 1.0
    assert gaussian_iou(np.zeros(len(labels), bool), labels, 2) == 0.0 == gaussian_iou(None, labels, 2)
    # What no photo shows counts neither method.
    assert gaussian_iou((labels == 2) | ~seen, labels, 2) == 1.0


def test_objects_without_true_masks_are_refused(evaluate) -> None:
    with pytest.raises(SettingsError, match="no true masks of 'ghost', only of: red ball, other red ball, blue ball"):
        evaluate(objects=("ghost",))


def test_without_held_out_photos_the_way_out_is_named(evaluate, project: ProjectFolder) -> None:
    held_out(project, ())
    with pytest.raises(SettingsError, match="Training saw all of the 8 photos .* --views all"):
        evaluate()


def test_masks_of_another_shape_are_refused(evaluate, blobs: BlobScene, tmp_path: Path) -> None:
    folder = write_truth(blobs, tmp_path / "square")
    for file in (folder / "masks").iterdir():
        with Image.open(file) as picture:
            square = picture.resize((120, 120), Image.Resampling.NEAREST)
        square.save(file)
    with pytest.raises(MaskError, match="120 x 120 pixels and 160 x 120"):
        evaluate(folder)


def test_true_masks_may_have_another_resolution(evaluate, blobs: BlobScene, tmp_path: Path) -> None:
    folder = write_truth(blobs, tmp_path / "large")
    for file in (folder / "masks").iterdir():
        with Image.open(file) as picture:
            large = picture.resize((320, 240), Image.Resampling.NEAREST)
        large.save(file)
    (row,) = evaluate(folder, objects=("blue ball",), presets=("paper",)).rows
    assert row.iou > 0.93 and row.psnr > 20


def test_progress_rises_and_stop_stops(evaluate) -> None:
    events: list[object] = []
    evaluate(objects=("blue ball",), presets=("paper",), emit=events.append)
    fractions = [event.fraction for event in events if isinstance(event, Progress)]
    assert fractions == sorted(fractions) and fractions[0] == 0.0 and not any(isinstance(e, Warned) for e in events)
    with pytest.raises(Cancelled):
        evaluate(should_stop=lambda: True)


def test_document_holds_its_command_and_where_it_was_measured(evaluate, tmp_path: Path) -> None:
    found = evaluate(presets=("paper",), objects=("blue ball",))
    write_evaluation(tmp_path / "docs" / "table.md", found, title="blobs", command="python -m engine evaluate blobs")
    text = (tmp_path / "docs" / "table.md").read_text(encoding="utf-8")
    assert "python -m engine evaluate blobs" in text and markdown(found) in text
    assert "2 photos with true masks (museum) are compared; training saw none of them: view_2.png, view_6.png" in text
    assert str(tmp_path) not in text
    with Image.open(tmp_path / "docs" / "table_blobs_mask.png") as picture:
        assert picture.format == "PNG"
    assert "](table_blobs_mask.png)" in text and text.count("## What the columns mean") == 1


def test_document_keeps_the_sections_of_other_scenes(evaluate, tmp_path: Path) -> None:
    found, doc = evaluate(presets=("paper",), objects=("blue ball",)), tmp_path / "table.md"
    for title, command in (("one", "command 1"), ("two", "command 2"), ("one", "command 3")):
        write_evaluation(doc, found, title=title, command=command)
    text = doc.read_text(encoding="utf-8")
    headings = [line for line in text.splitlines() if line.startswith("#")]
    assert headings == [
        "# Segmentation of objects",
        "## one, prompted by true masks",
        "## two, prompted by true masks",
        "## What the columns mean",
    ]
    assert "command 1" not in text and text.index("command 3") < text.index("command 2")


def test_settings_that_make_no_sense_are_refused() -> None:
    for wrong in ({"presets": ()}, {"presets": ("best",)}, {"presets": ("paper", "paper")}, {"prompt_kind": "box"},
        {"view_counts": (0,)}, {"view_counts": (4, 4)}, {"prompt_kind": "all", "presets": ("paper",)}):  # fmt: skip
        with pytest.raises(SettingsError):
            EvaluationSettings(**wrong)
    with pytest.raises(SettingsError, match="better among them"):
        EvaluationSettings(presets=("paper",), ablations=True)
    assert [method.settings for method in methods_of(EvaluationSettings())] == [PAPER, BETTER]


def test_mean_passes_over_what_could_not_be_measured() -> None:
    assert mean_of([1.0, math.nan, 3.0]) == 2.0
    assert math.isnan(mean_of([math.nan]))
