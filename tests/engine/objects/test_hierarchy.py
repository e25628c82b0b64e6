from __future__ import annotations

import numpy as np
import pytest

from engine.objects.hierarchy import Hierarchy, build_hierarchy
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
    for part in (RED, TWIN, BLUE):
        assert max(iou(one, blobs.part == part) for one in groups.members) > 0.95


def test_groups_are_nested_or_disjoint(groups: Hierarchy) -> None:
    assert len(groups.groups) == 2 * groups.n_finest - 1
    for first, stop in groups.groups:
        assert 0 <= first < stop <= groups.n_finest
        for other_first, other_stop in groups.groups:
            nested = (first <= other_first and other_stop <= stop) or (other_first <= first and stop <= other_stop)
            assert nested or stop <= other_first or other_stop <= first


def test_the_same_scene_falls_into_the_same_groups(groups: Hierarchy, blobs: BlobScene) -> None:
    again = hierarchy_of(blobs)
    assert np.array_equal(groups.finest, again.finest) and np.array_equal(groups.groups, again.groups)


@pytest.mark.parametrize("count", [1, 2, 4, 12])
def test_a_handful_of_gaussians_has_few_groups_or_none(count: int, blobs: BlobScene) -> None:
    few = blobs.gaussians[:count]
    scene = Scene(few)
    found = build_hierarchy(Views(scene, blobs.cameras, render_side=160))
    assert found.finest.shape == (count,) and found.finest.max() < max(1, found.n_finest)


def test_cut_takes_a_group_unless_its_parts_score_more() -> None:
    #        4
    #     3     \
    #   0   1    2
    groups = np.array([[0, 1], [1, 2], [2, 3], [0, 2], [0, 3]], np.int32)
    tree = Hierarchy(np.array([0, 1, 2, -1], np.int32), groups)
    assert sorted(tree.cut(np.array([1.0, 1, 1, 3, 2]))) == [2, 3]
    assert tree.cut(np.array([1.0, 1, 1, 2, 3])) == [4]
    assert sorted(tree.cut(np.array([2.0, 1, 1, 2.5, 3]))) == [0, 1, 2]
    np.testing.assert_array_equal(tree.members, [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [1, 1, 0, 0], [1, 1, 1, 0]])
