from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from engine.masks import mask_iou
from engine.objects.groups import build_groups
from engine.objects.views import Views
from engine.pictures.scene import Scene
from tests.engine.pictures.blob_scene import BLUE, RED, TWIN, BlobScene


def groups_of(scene: BlobScene) -> np.ndarray:
    return build_groups(Views(Scene(scene.gaussians), scene.cameras, render_side=160))


@pytest.fixture(scope="module")
def groups(blobs: BlobScene) -> np.ndarray:
    return groups_of(blobs)


def test_every_object_is_one_of_the_groups_and_equal_objects_are_two(groups: np.ndarray, blobs: BlobScene) -> None:
    for part in (RED, TWIN, BLUE):
        assert max(mask_iou(one, blobs.part == part) for one in groups) > 0.95


def test_groups_are_nested_or_disjoint_and_none_is_empty_or_there_twice(groups: np.ndarray) -> None:
    assert groups.any(axis=1).all() and len(np.unique(groups, axis=0)) == len(groups)
    sizes = groups.sum(axis=1)
    for one in groups:
        common = (groups & one).sum(axis=1)
        assert ((common == 0) | (common == np.minimum(sizes, one.sum()))).all()


def test_the_same_scene_falls_into_the_same_groups(groups: np.ndarray, blobs: BlobScene) -> None:
    assert np.array_equal(groups, groups_of(blobs))


def test_gaussians_far_from_the_scene_are_in_no_group(blobs: BlobScene) -> None:
    means = blobs.gaussians.means.copy()
    means[:5] += np.float32(1000)
    found = groups_of(replace(blobs, gaussians=replace(blobs.gaussians, means=means)))
    assert not found[:, :5].any() and found[:, 5:].any()


@pytest.mark.parametrize("count", [1, 2, 4, 12])
def test_a_handful_of_gaussians_has_few_groups_or_none(count: int, blobs: BlobScene) -> None:
    few = blobs.gaussians[:count]
    found = build_groups(Views(Scene(few), blobs.cameras, render_side=160))
    assert found.shape[1] == count and len(found) <= count // 4
