from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from engine.core.errors import Cancelled
from engine.core.events import Event, Progress
from engine.masks import mask_iou
from engine.objects.context import SegmentationContext
from engine.objects.found import FoundObject
from engine.objects.looks import Looks, build_looks
from engine.objects.segment import find_everything
from engine.objects.settings import BETTER
from engine.project.folder import ProjectFolder
from engine.project.objects import ObjectRecord, list_objects, load_membership, save_object
from engine.scene.detailed import load_detailed
from tests.engine.objects.fakes import FakeDetector, segmenter_of, trained_project
from tests.engine.pictures.blob_scene import BLUE, FLOOR, RED, TWIN, BlobScene

SMALL = replace(BETTER, photo_side=160, render_side=160, detail_steps=3)


def look(blobs: BlobScene, folder: Path) -> tuple[ProjectFolder, SegmentationContext]:
    project = trained_project(blobs, folder)
    return project, segmenter_of(project, blobs, SMALL).context


def everything(context: SegmentationContext, **given: object) -> list[FoundObject]:
    return find_everything(replace(context, **given))


def test_every_object_is_found_once_and_the_floor_is_not(blobs: BlobScene, tmp_path: Path) -> None:
    _, context = look(blobs, tmp_path)
    events: list[Event] = []
    found = everything(context, emit=events.append)
    assert len(found) == 3
    for part, name in ((RED, "red ball"), (TWIN, "red ball"), (BLUE, "blue ball")):
        best = max(found, key=lambda one: mask_iou(one.members, blobs.part == part))
        assert mask_iou(best.members, blobs.part == part) > 0.9
        assert best.name == name and best.score > 0.8
    assert np.sum([one.members for one in found], axis=0).max() == 1, "a Gaussian belongs to one object at most"
    fractions = [event.fraction for event in events if isinstance(event, Progress)]
    assert fractions == sorted(fractions)


def test_what_was_found_without_a_prompt_has_levels_from_part_to_whole(blobs: BlobScene, tmp_path: Path) -> None:
    _, context = look(blobs, tmp_path)
    made, half = build_looks(context), (blobs.part == BLUE) & (blobs.gaussians.means[:, 0] < 0)
    number = np.zeros(1, np.int32)
    sighting = (number, made.photo[:1], made.box[:1], made.described[:1])
    context.kept["looks"] = Looks(half[None], np.ones(1, np.float32), number, *sighting)
    (found,) = everything(context)
    first, *_, last = (level >= 0.5 for level in found.levels.memberships)
    assert mask_iou(first, half) > 0.9 and mask_iou(last, blobs.part == BLUE) > 0.9


def test_of_two_that_reach_into_each_other_the_likelier_keeps_its_gaussians(blobs: BlobScene, tmp_path: Path) -> None:
    _, context = look(blobs, tmp_path)
    made = build_looks(context)
    ball, twin = (blobs.part == part for part in (RED, TWIN))
    reaching = twin | (ball & (np.cumsum(ball) <= 0.3 * ball.sum()))
    sizes, numbers = (ball.sum(), reaching.sum()), np.arange(2, dtype=np.int32)
    assert sizes[0] < sizes[1]
    for likelier in (0, 1):
        odds = np.array([3 - 2 * likelier, 1 + 2 * likelier], np.float32)
        sightings = (numbers, made.photo[:1] * 2, made.box[[0, 0]], made.described[[0, 0]])
        context.kept["looks"] = Looks(np.stack([ball, reaching]), odds, numbers, *sightings)
        found = everything(context)
        in_ball, in_twin = (max(found, key=lambda one: int((one.members & part).sum())) for part in (ball, twin))
        assert in_ball is not in_twin
        assert not (in_ball.members & in_twin.members).any()
        whole = mask_iou(in_ball.members, ball)
        assert whole > 0.95 if likelier == 0 else whole < 0.95


def test_what_is_mostly_the_foot_of_a_likelier_object_is_left_out(
    blobs: BlobScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, context = look(blobs, tmp_path)
    made = build_looks(context)
    ball, twin = (blobs.part == part for part in (RED, TWIN))
    heights = blobs.gaussians.means[:, 2]
    upper = ball & (heights > np.median(heights[ball]))
    lower = (ball & ~upper) | (twin & (np.cumsum(twin) <= 0.3 * ball.sum()))

    def stands(members: np.ndarray, *_: object) -> np.ndarray:
        return members | ball if (members & upper).sum() > 0.9 * upper.sum() else lower

    monkeypatch.setattr("engine.objects.lifting.standing", stands)
    numbers = np.arange(2, dtype=np.int32)
    sightings = (numbers, made.photo[:1] * 2, made.box[[0, 0]], made.described[[0, 0]])
    context.kept["looks"] = Looks(np.stack([upper, lower]), np.array([3, 1], np.float32), numbers, *sightings)
    (found,) = everything(context)
    assert mask_iou(found.members, ball) > 0.95


def test_what_does_not_look_whole_is_no_object(blobs: BlobScene, tmp_path: Path) -> None:
    project, _ = look(blobs, tmp_path)

    class Doubtful(FakeDetector):
        def whole_odds(self, described):  # type: ignore[no-untyped-def]
            return np.where(described.argmax(axis=1) == BLUE, np.float32(-9), np.float32(0))

    found = find_everything(segmenter_of(project, blobs, SMALL, detector_factory=lambda: Doubtful(blobs)).context)
    best = {part: max(mask_iou(one.members, blobs.part == part) for one in found) for part in (RED, TWIN, BLUE)}
    assert best[RED] > 0.9 and best[TWIN] > 0.9 and best[BLUE] < 0.5


def test_parts_that_the_segments_show_as_one_are_one_object(blobs: BlobScene, tmp_path: Path) -> None:
    features = blobs.gaussians.features.copy()
    left = (blobs.part == BLUE) & (blobs.gaussians.means[:, 0] < 0)
    features[left] += np.roll(features[left], 1, axis=1)  # a cosine of 0.7 with the other half
    scene = replace(blobs, gaussians=replace(blobs.gaussians, features=features))
    _, context = look(scene, tmp_path)
    found = everything(context)
    assert max(mask_iou(one.members, scene.part == BLUE) for one in found) > 0.9
    assert len(found) == 3


def test_unsure_names_are_numbers_and_the_background_is_the_rest(blobs: BlobScene, tmp_path: Path) -> None:
    project, _ = look(blobs, tmp_path)

    class Unsure(FakeDetector):
        def name_descriptions(self, described):  # type: ignore[no-untyped-def]
            return [(word, 0.1 * score) for word, score in super().name_descriptions(described)]

    unsure = segmenter_of(project, blobs, SMALL, detector_factory=lambda: Unsure(blobs))
    made, kept, background = unsure.segment_everything()
    assert sorted(record.name for record in made) == ["object 1", "object 2", "object 3"] and not kept
    assert all(record.prompt == {"kind": "all", "name": record.name} and record.score == 0.0 for record in made)
    assert background.id == "background"
    assert all(load_detailed(project.path, record.id) is None for record in made)
    assert load_detailed(project.path, "background") is None
    objects = [load_membership(project.path, record.id) >= 0.5 for record in made]
    rest = load_membership(project.path, "background") >= 0.5
    np.testing.assert_array_equal(rest, ~np.logical_or.reduce(objects))
    assert rest[blobs.part == FLOOR].mean() > 0.95


def test_existing_objects_are_kept_and_not_stored_twice(blobs: BlobScene, tmp_path: Path) -> None:
    project, _ = look(blobs, tmp_path)
    mine = ObjectRecord("kugel", "Kugel", {"kind": "click"}, 0.5, 0.9, 0.9, 150, len(blobs.gaussians))
    save_object(project.path, mine, (blobs.part == BLUE).astype(np.float32))
    made, kept, _ = segmenter_of(project, blobs, SMALL).segment_everything()
    assert kept == ["kugel"] and [record.name for record in made] == ["red ball", "red ball-2"]
    assert sorted(record.id for record in list_objects(project.path)) == [
        "background", "kugel", "red-ball", "red-ball-2"
    ]  # fmt: skip


def test_stopping_stores_nothing(blobs: BlobScene, tmp_path: Path) -> None:
    project, context = look(blobs, tmp_path)
    with pytest.raises(Cancelled):
        everything(context, should_stop=lambda: True)
    assert list_objects(project.path) == []
