from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.special import logit

from engine.core.errors import Cancelled
from engine.core.events import Event, Progress
from engine.masks import mask_iou
from engine.objects.context import SegmentationContext
from engine.objects.proposals import LEAST_PROBABILITY, Proposals, choose_sets, find_proposals, gains_of
from engine.objects.settings import BETTER
from engine.objects.views import Views
from engine.pictures.scene import Scene
from tests.engine.pictures.blob_scene import BLUE, RED, TWIN, BlobScene


def context_of(scene: BlobScene, **given: Any) -> SegmentationContext:
    """A context without photos and detector, which no proposal needs."""
    views = Views(Scene(scene.gaussians), scene.cameras, render_side=160)
    nothing: Any = None
    return SegmentationContext(views, nothing, scene.labels, BETTER, nothing, **given)


def proposals_of(scene: BlobScene) -> Proposals:
    return find_proposals(context_of(scene))


def test_each_object_is_a_likely_proposal(blobs: BlobScene) -> None:
    found = proposals_of(blobs)
    assert (found.odds >= logit(LEAST_PROBABILITY) - 1e-6).all() and (np.diff(found.odds) <= 0).all()
    assert found.shown.shape == (len(found.members), len(blobs.labels)) and found.shown.any(axis=1).all()
    for part in (RED, TWIN, BLUE):
        best = int(np.argmax([mask_iou(one, blobs.part == part) for one in found.members]))
        assert mask_iou(found.members[best], blobs.part == part) > 0.9
        assert found.odds[best] > 0


def test_a_set_that_many_segments_lead_to_is_one_proposal(blobs: BlobScene) -> None:
    members = proposals_of(blobs).members
    overlaps = [mask_iou(one, other) for k, one in enumerate(members) for other in members[:k]]
    assert max(overlaps, default=0.0) <= 0.95


def test_what_looks_alike_is_told_by_its_likeliest_version(blobs: BlobScene) -> None:
    found = proposals_of(blobs)
    numbers = np.arange(len(found.members))
    assert (found.like <= numbers).all() and (found.like[found.like] == found.like).all()
    own = found.members[found.like == numbers]
    assert max((mask_iou(one, other) for k, one in enumerate(own) for other in own[:k]), default=0.0) <= 0.9


def test_an_object_without_segments_is_a_proposal_by_its_group_but_nothing_is_without_any(blobs: BlobScene) -> None:
    labels = {photo: np.where(label == BLUE, 0, label) for photo, label in blobs.labels.items()}
    found = proposals_of(replace(blobs, labels=labels))
    assert max(mask_iou(one, blobs.part == BLUE) for one in found.members) > 0.9
    assert len(proposals_of(replace(blobs, labels={})).members) == 0


def test_the_whole_scene_is_no_proposal(blobs: BlobScene) -> None:
    labels = {photo: np.where(label == BLUE, 2, 1) for photo, label in blobs.labels.items()}
    found = proposals_of(replace(blobs, labels=labels))
    assert len(found.members) > 0
    assert found.members.mean(axis=1).max() < 0.9


def test_what_stands_on_the_floor_is_likelier_an_object_than_the_same_hanging_from_a_ceiling(blobs: BlobScene) -> None:
    upside_down = blobs.gaussians.means * np.array([1, 1, -1], np.float32)
    context = context_of(blobs)

    class UpsideDown(SegmentationContext):
        means = upside_down

    standing, hanging = find_proposals(context), find_proposals(UpsideDown(**vars(context)))
    for part in (RED, TWIN, BLUE):
        best = [
            max(zip((mask_iou(one, blobs.part == part) for one in found.members), found.odds, strict=True))
            for found in (standing, hanging)
        ]
        assert min(overlap for overlap, _ in best) > 0.9
        assert best[0][1] > best[1][1]


@pytest.mark.parametrize("factor", [0.002, 50.0])
def test_what_is_far_smaller_or_larger_than_a_usual_object_is_no_proposal(factor: float, blobs: BlobScene) -> None:
    context = context_of(blobs)

    class FarOrNear(Views):
        def extent(self, members: np.ndarray) -> float:
            return factor * super().extent(members)

    scaled = FarOrNear(context.views.scene, context.views.cameras, render_side=160)
    found = find_proposals(replace(context, views=scaled))
    assert len(found.members) == 0


def test_looking_for_proposals_can_be_stopped_and_reports_progress(blobs: BlobScene) -> None:
    with pytest.raises(Cancelled, match="no object was stored"):
        find_proposals(context_of(blobs, should_stop=lambda: True))
    events: list[Event] = []
    find_proposals(context_of(blobs, emit=events.append))
    fractions = [event.fraction for event in events if isinstance(event, Progress)]
    assert fractions == sorted(fractions) and fractions[-1] == 1.0


WHOLE, LEFT, RIGHT, OTHER = np.array(
    [[1, 1, 1, 1, 1, 1, 0, 0], [1, 1, 1, 0, 0, 0, 0, 0], [0, 0, 0, 1, 1, 1, 0, 0], [0, 0, 0, 0, 0, 1, 1, 1]], bool
)


@pytest.mark.parametrize(
    ("gains", "chosen"),
    [
        ((0.5, 0.2, 0.2, 0.0), [0]),
        ((0.5, 0.4, 0.3, 0.0), [1, 2]),  # two parts gain more than their whole
        ((0.5, 0.2, 0.2, 0.1), [0, 3]),  # a third of the smaller one is no conflict
        ((0.0, -0.1, 0.2, 0.3), [3, 2]),
        ((0.0, -0.1, -0.2, 0.0), []),
    ],
)
def test_sets_apart_gain_most_together(gains: tuple[float, ...], chosen: list[int]) -> None:
    assert choose_sets(np.array([WHOLE, LEFT, RIGHT, OTHER]), np.array(gains)) == chosen


@pytest.mark.parametrize(
    ("probabilities", "chosen"),
    [((0.92, 0.77, 0.41), [0]), ((0.7, 0.65, 0.65), [1, 2])],
    ids=["halves of an hourglass", "two things that touch"],
)
def test_whole_is_chosen_before_halves_that_are_less_likely(probabilities: list[float], chosen: list[int]) -> None:
    assert choose_sets(np.array([WHOLE, LEFT, RIGHT]), gains_of(logit(probabilities))) == chosen


def test_several_sets_take_the_place_of_the_first_one_and_one_that_of_several() -> None:
    sets = np.array([[1, 1, 1, 1, 0, 0], [0, 0, 1, 1, 1, 1], [0, 1, 1, 1, 1, 0], [1, 1, 1, 1, 1, 1]], bool)
    assert choose_sets(sets, np.array([0.4, 0.35, 0.5, 0.1])) == [0, 1]
    assert choose_sets(sets, np.array([0.4, 0.35, 0.5, 0.9])) == [3]
