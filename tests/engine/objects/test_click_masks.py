"""What clicks mean while the user clicks: the masks that isolating and correcting begin with."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path

import numpy as np
import pytest

from engine.cli.main import main
from engine.core.errors import PromptError
from engine.masks import mask_iou
from engine.objects import Point, click_masks, load_context
from engine.objects.context import SegmentationContext
from engine.objects.evidence import evidence_of_clicks
from engine.objects.grounding import load_default_detector
from engine.objects.settings import BETTER
from engine.project.folder import ProjectFolder
from engine.workers.jobs import Click, click_question
from engine.workers.jobs.click_preview import _answer
from tests.engine.objects.fakes import FakeDetector, FakeSam, trained_project
from tests.engine.pictures.blob_scene import BLUE, RED, BlobScene

PHOTO = "view_2.png"


@pytest.fixture
def project(blobs: BlobScene, tmp_path: Path) -> ProjectFolder:
    return trained_project(blobs, tmp_path)


@pytest.fixture
def context(blobs: BlobScene, project: ProjectFolder) -> SegmentationContext:
    return load_context(project, BETTER, load_default_detector, lambda: FakeSam(blobs))


def center(blobs: BlobScene, part: int) -> Point:
    return Point(PHOTO, *blobs.center_of(part, PHOTO))


def test_click_shows_what_the_engine_takes_it_for(blobs: BlobScene, context: SegmentationContext) -> None:
    clicked = center(blobs, RED)
    masks = click_masks(context, PHOTO, [clicked], [])
    (evidence,) = evidence_of_clicks([clicked], [], context)
    np.testing.assert_array_equal(masks.wanted, evidence.view.to_photo(evidence.mask))
    assert mask_iou(masks.wanted, blobs.labels[PHOTO] == RED) > 0.8
    assert not masks.unwanted.any() and not masks.present.any()


def test_click_shows_the_whole_object_once_the_scene_was_looked_at(blobs: BlobScene, project: ProjectFolder) -> None:
    clicked, found = center(blobs, RED), blobs.part == RED
    context = load_context(project, BETTER, lambda: FakeDetector(blobs), lambda: FakeSam(blobs))
    context.kept["objects"] = np.stack([blobs.part == BLUE, found])
    shown = click_masks(context, PHOTO, [clicked], []).wanted
    view = context.views.of(context.views.cameras.by_photo[PHOTO])
    np.testing.assert_array_equal(shown, view.to_photo(context.views.visible(view, found) & view.within))
    # A correction begins with what its clicks show, not with whole objects.
    (evidence,) = evidence_of_clicks([clicked], [], context)
    masks = click_masks(context, PHOTO, [clicked], [], blobs.part == BLUE)
    np.testing.assert_array_equal(masks.wanted, evidence.view.to_photo(evidence.mask))


def test_click_beside_the_object_is_taken_away_and_shown(blobs: BlobScene, context: SegmentationContext) -> None:
    wanted, unwanted = center(blobs, RED), center(blobs, BLUE)
    both = click_masks(context, PHOTO, [wanted, unwanted], [])
    masks = click_masks(context, PHOTO, [wanted], [unwanted])
    blue = blobs.labels[PHOTO] == BLUE
    assert (both.wanted & blue).any() and not (masks.wanted & blue).any()
    assert mask_iou(masks.unwanted, blue) > 0.95


def test_correction_shows_what_the_object_has_now(blobs: BlobScene, context: SegmentationContext) -> None:
    masks = click_masks(context, PHOTO, [], [], blobs.part == BLUE)
    assert mask_iou(masks.present, blobs.labels[PHOTO] == BLUE) > 0.7
    assert not masks.wanted.any()


def test_clicks_on_other_photos_change_nothing_here_and_wrong_ones_are_told(
    blobs: BlobScene, context: SegmentationContext
) -> None:
    masks = click_masks(context, PHOTO, [Point("view_1.png", 80.0, 60.0)], [])
    assert not masks.wanted.any()
    with pytest.raises(PromptError, match="lies outside"):
        click_masks(context, PHOTO, [Point(PHOTO, 5000.0, 1.0)], [])


def test_command_answers_each_line_and_goes_on_after_a_wrong_one(
    blobs: BlobScene, project: ProjectFolder, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    x, y = blobs.center_of(RED, PHOTO)
    lines = ["no question", click_question("gone.jpg", []), click_question(PHOTO, [Click(PHOTO, x, y)])]
    monkeypatch.setattr(sys, "stdin", io.StringIO("\n".join(lines) + "\n"))
    assert main(["show-clicks", str(project.path), "--events"]) == 0
    said = [json.loads(line)["outputs"] for line in capsys.readouterr().out.splitlines() if "finished" in line]
    answers = [_answer(outputs) for outputs in said]
    assert "cannot be read" in answers[0].problem and "gone.jpg" in answers[1].problem
    assert not answers[2].problem and answers[2].photo == PHOTO
    assert mask_iou(answers[2].masks["wanted"], blobs.labels[PHOTO] == RED) > 0.8
