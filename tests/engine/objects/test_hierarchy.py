from __future__ import annotations

import numpy as np
import pytest

from engine.objects.hierarchy import UNGROUPED, Hierarchy, build_hierarchy
from engine.objects.views import Views
from engine.pictures.scene import Scene
from tests.engine.pictures.blob_scene import BLUE, RED, TWIN, BlobScene


def hierarchy_of(scene: BlobScene) -> Hierarchy:
    return build_hierarchy(Views(Scene(scene.gaussians), scene.cameras, render_side=160))


@pytest.fixture(scope="module")
def groups(blobs: BlobScene) -> Hierarchy:
    return hierarchy_of(blobs)


def iou(one: np.ndarray, other: np.ndarray) -> float:
    return float((one & other).sum() / (one | other).sum())


def test_every_object_is_one_of_the_groups_and_equal_objects_are_two(groups: Hierarchy, blobs: BlobScene) -> None:
    members = [groups.members(k) for k in range(len(groups.groups))]
    for part in (RED, TWIN, BLUE):
        assert max(iou(one, blobs.part == part) for one in members) > 0.95


def test_groups_lie_one_in_the_other_or_apart(groups: Hierarchy) -> None:
    assert len(groups.groups) == 2 * groups.n_finest - 1
    for first, stop in groups.groups:
        assert 0 <= first < stop <= groups.n_finest
        for other_first, other_stop in groups.groups:
            nested = (first <= other_first and other_stop <= stop) or (other_first <= first and stop <= other_stop)
            assert nested or stop <= other_first or other_stop <= first


def test_an_object_stands_out_and_half_of_it_or_it_with_the_floor_does_not(groups: Hierarchy, blobs: BlobScene) -> None:
    blue = blobs.part == BLUE
    likeness = [iou(groups.members(k), blue) for k in range(len(groups.groups))]
    best = int(np.argmax(likeness))
    first, stop = groups.groups[best]
    related = [
        k
        for k, (a, b) in enumerate(groups.groups)
        if k != best and b - a < groups.n_finest and ((a <= first and stop <= b) or (first <= a and b <= stop))
    ]
    assert related
    assert groups.standing[best] > 0.7 > groups.standing[related].max()
    assert groups.standing_of(blue) == groups.standing[best]
    assert ((groups.standing >= 0) & (groups.standing <= 1)).all()


def test_what_is_like_no_group_stands_out_little(groups: Hierarchy, blobs: BlobScene) -> None:
    scattered = np.zeros(len(blobs.gaussians), bool)
    scattered[::9] = True
    assert groups.standing_of(scattered) == UNGROUPED
    assert groups.standing_of(np.zeros(len(blobs.gaussians), bool)) == UNGROUPED


def test_the_same_scene_falls_into_the_same_groups(groups: Hierarchy, blobs: BlobScene) -> None:
    again = hierarchy_of(blobs)
    assert np.array_equal(groups.finest, again.finest) and np.array_equal(groups.groups, again.groups)


@pytest.mark.parametrize("count", [1, 2, 4, 12])
def test_a_handful_of_gaussians_has_few_groups_or_none(count: int, blobs: BlobScene) -> None:
    few = blobs.gaussians[:count]
    scene = Scene(few)
    found = build_hierarchy(Views(scene, blobs.cameras, render_side=160))
    assert found.finest.shape == (count,) and found.finest.max() < max(1, found.n_finest)
    assert found.standing_of(np.ones(count, bool)) >= 0


def test_the_whole_scene_stands_out_from_nothing(groups: Hierarchy) -> None:
    sizes = [int(groups.members(k).sum()) for k in range(len(groups.groups))]
    assert groups.standing[int(np.argmax(sizes))] == 0
