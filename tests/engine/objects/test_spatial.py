from __future__ import annotations

import numpy as np
import pytest

from engine.core.errors import PromptError
from engine.objects.spatial import Extent, SpatialText, choose, parse_spatial, showing_camera
from engine.objects.views import inner_box
from engine.scene import PinholeCamera
from tests.engine.pictures.blob_scene import BlobScene

FRONT = PinholeCamera(
    np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 5], [0, 0, 0, 1]]), np.diag([100.0, 100, 1]), 200, 200
)
"""Looks along +Y from (0, -5, 0) with Z up, so that +X is right."""
BACK = PinholeCamera(
    np.array([[-1.0, 0, 0, 0], [0, 0, -1, 0], [0, -1, 0, 5], [0, 0, 0, 1]]), np.diag([100.0, 100, 1]), 200, 200
)


def box(x: float, z: float, size: float = 1.0, y: float = 0.0) -> Extent:
    center = np.array([x, y, z])
    return Extent(center - size / 2, center, center + size / 2)


@pytest.mark.parametrize(
    ("text", "parsed"),
    [
        ("vase", SpatialText("vase")),
        ("Church Bell", SpatialText("Church Bell")),
        ("the left vase", SpatialText("vase", "left")),
        ("Leftmost  vase", SpatialText("vase", "left")),
        ("largest pot", SpatialText("pot", "largest")),
        ("the smallest clay pot", SpatialText("clay pot", "smallest")),
        ("vase on the right", SpatialText("vase", "right")),
        ("bowl on the table", SpatialText("bowl", "on", "table")),
        ("bowl on top of a table", SpatialText("bowl", "on", "table")),
        ("ball inside of the crate", SpatialText("ball", "in", "crate")),
        ("bell next to the clock", SpatialText("bell", "next to", "clock")),
        ("vase to the left of the bell", SpatialText("vase", "left", "bell")),
        ("leftover bowl", SpatialText("leftover bowl")),
        ("statue of Buddha", SpatialText("statue of Buddha")),
    ],
)
def test_spatial_words_are_taken_off_the_noun(text: str, parsed: SpatialText) -> None:
    assert parse_spatial(text) == parsed


def test_left_and_right_depend_on_where_one_looks_from() -> None:
    found = [box(-2, 0), box(3, 0), box(0, 0)]
    assert choose(SpatialText("vase", "left"), found, [], FRONT) == [0]
    assert choose(SpatialText("vase", "right"), found, [], FRONT) == [1]
    assert choose(SpatialText("vase", "left"), found, [], BACK) == [1]
    assert choose(SpatialText("vase", "left", "bell"), found, [box(1, 0)], FRONT) == [0, 2]


def test_left_without_a_camera_is_refused_in_one_sentence() -> None:
    with pytest.raises(PromptError, match="'left' needs a photo or a view"):
        choose(SpatialText("vase", "left"), [box(0, 0)], [], None)


def test_size_is_that_in_the_scene_and_not_in_the_picture() -> None:
    near_and_small, far_and_large = box(0, 0, 1.0, y=-3), box(0, 0, 1.5, y=20)
    assert choose(SpatialText("pot", "largest"), [near_and_small, far_and_large], [], FRONT) == [1]
    assert choose(SpatialText("pot", "smallest"), [near_and_small, far_and_large], [], FRONT) == [0]


def test_what_is_on_in_and_next_to_something() -> None:
    table, on, under, beside, far = box(0, 0, 2.0), box(0.2, 1.4, 0.8), box(0, -1.5), box(2.0, 0), box(9, 0)
    inside = box(0.1, -0.3, 0.4)
    found = [under, on, beside, far, inside]
    assert choose(SpatialText("bowl", "on", "table"), found, [table], None) == [1]
    assert choose(SpatialText("bowl", "in", "table"), found, [table], None) == [4]
    assert choose(SpatialText("bowl", "next to", "table"), [under, beside, far][1:], [table], None) == [0]


@pytest.mark.parametrize(("others", "reason"), [([box(20, 0)], ""), ([], "no 'table' was found")])
def test_a_relation_that_nothing_has_is_refused_in_one_sentence(others: list[Extent], reason: str) -> None:
    with pytest.raises(PromptError, match=f"There is no 'bowl' on 'table'.*{reason}"):
        choose(SpatialText("bowl", "on", "table"), [box(0, 0)], others, None)


def test_an_object_is_not_next_to_itself() -> None:
    vases = [box(0, 0), box(1.5, 0), box(30, 0)]
    assert choose(SpatialText("vase", "next to", "vase"), [vases[0], vases[2]], vases, None) == [0]


def test_far_gaussians_do_not_change_an_extent() -> None:
    means = np.random.default_rng(0).uniform(-1, 1, (500, 3))
    extent = Extent(*inner_box(np.vstack([means, np.full((5, 3), 1000.0)])))
    assert (np.abs([extent.low, extent.high]) <= 1).all()


def test_the_photo_that_shows_most_is_asked(blobs: BlobScene) -> None:
    extents = [Extent(*inner_box(blobs.gaussians.means[blobs.part == part])) for part in (1, 2)]
    assert showing_camera(blobs.cameras.cameras, extents) in blobs.cameras.cameras
    with pytest.raises(PromptError, match="no photo"):
        showing_camera([], extents)
