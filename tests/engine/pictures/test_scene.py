from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from engine.core.arrays import normalized
from engine.pictures.clusters import cluster_colors, find_clusters, principal_colors
from engine.pictures.scene import Scene
from engine.rasterizer import rasterize
from engine.rasterizer.settings import RasterSettings
from tests.engine.pictures.blob_scene import BLUE, BlobScene, as_pinhole


def test_votes_count_the_pixels_each_gaussian_contributes(blobs: BlobScene) -> None:
    scene, camera = Scene(blobs.gaussians), as_pinhole(blobs.cameras.cameras[0])
    mask = blobs.labels[blobs.cameras.cameras[0].photo] == BLUE
    votes = scene.votes(camera, np.dstack([mask, np.ones_like(mask)]).astype(np.float32))
    # Law: all votes of all Gaussians together are the covered pixels.
    assert abs(votes[:, 1].sum() - scene.render(camera, channels=np.ones((len(scene), 1))).alpha.sum()) < 1
    assert votes[blobs.part == BLUE, 0].sum() > 0.9 * mask.sum()
    assert (votes[:, 0] <= votes[:, 1] + 1e-4).all()


def test_votes_and_pictures_are_the_same_weighted_sum(blobs: BlobScene) -> None:
    scene, camera = Scene(blobs.gaussians), as_pinhole(blobs.cameras.cameras[4])
    rng = np.random.default_rng(0)
    values = rng.random((len(scene), 1), np.float32)
    weights = rng.random((camera.height, camera.width, 1), np.float32)
    by_picture = (scene.render(camera, channels=values).channels * weights).sum(dtype=np.float64)
    by_votes = (scene.votes(camera, weights) * values).sum(dtype=np.float64)
    # float32 sums of 19,200 pixels over 950 Gaussians; worst seen 4e-7 relative.
    assert abs(by_picture - by_votes) < 1e-5 * by_picture


def test_more_channels_than_one_picture_holds_are_rendered_and_counted_all_the_same(blobs: BlobScene) -> None:
    scene, camera = Scene(blobs.gaussians), as_pinhole(blobs.cameras.cameras[1])
    values = np.random.default_rng(1).random((len(scene), 70), np.float32)
    weights = np.random.default_rng(2).random((camera.height, camera.width, 70), np.float32)
    rendered, votes = scene.render(camera, color=True, channels=values), scene.votes(camera, weights)
    assert rendered.channels.shape == (camera.height, camera.width, 73)
    near = {"rtol": 1e-5, "atol": 1e-6}
    np.testing.assert_allclose(rendered.channels[..., :3], scene.render(camera, color=True).channels, **near)
    for k in (0, 60, 61, 69):
        one = scene.render(camera, channels=values[:, k : k + 1])
        np.testing.assert_allclose(rendered.channels[..., 3 + k], one.channels[..., 0], **near)
        np.testing.assert_allclose(votes[:, k], scene.votes(camera, weights[..., k : k + 1])[:, 0], **near)
    np.testing.assert_allclose(rendered.alpha, one.alpha, **near)


def test_empty_scene_renders_nothing(blobs: BlobScene) -> None:
    empty = Scene(blobs.gaussians[:0])
    camera = as_pinhole(blobs.cameras.cameras[0])
    assert not empty.render(camera, color=True).channels.any()
    assert empty.votes(camera, np.ones((camera.height, camera.width, 2))).shape == (0, 2)


def test_zero_vectors_stay_zero() -> None:
    np.testing.assert_allclose(normalized(np.array([[3.0, 4.0], [0.0, 0.0]])), [[0.6, 0.8], [0, 0]], rtol=1e-6)


def test_clusters_are_the_parts(blobs: BlobScene) -> None:
    assert blobs.gaussians.features is not None
    centers = find_clusters(blobs.gaussians.features, blobs.gaussians.opacities)
    assert len(centers) == 4
    assert set(np.abs(centers).argmax(axis=1)) == {2, 5, 8, 11}


def test_clusters_of_nothing_are_none() -> None:
    assert find_clusters(np.zeros((5, 16)), np.ones(5)).shape == (0, 16)
    assert find_clusters(np.ones((5, 16)), np.zeros(5)).shape == (0, 16)
    assert cluster_colors(0).shape == (0, 3)
    assert len({tuple(color) for color in cluster_colors(64)}) == 64


def test_feature_colours_do_not_depend_on_the_order_of_gaussians(blobs: BlobScene) -> None:
    features, weights = blobs.gaussians.features, blobs.gaussians.opacities
    assert features is not None
    turned = principal_colors(features[::-1], weights[::-1])
    for one, other in zip(principal_colors(features, weights), turned, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-4)


@pytest.mark.parametrize("backend", ["cpu", "reference"])
def test_gaussians_of_anti_aliased_training_are_rendered_anti_aliased(blobs: BlobScene, backend: Any) -> None:
    small = replace(blobs.gaussians, log_scales=blobs.gaussians.log_scales - 2.5)
    camera, settings = as_pinhole(blobs.cameras.cameras[0]), RasterSettings(antialiased=True)
    mip, plain = (Scene(replace(small, antialiased=mip), backend=backend) for mip in (True, False))
    arrays = [torch.from_numpy(array) for array in (small.means, small.quats, small.scales, small.opacities)]
    expected = rasterize(*arrays, camera=camera, sh=torch.from_numpy(small.sh), backend=backend, settings=settings)
    np.testing.assert_allclose(mip.render(camera, color=True).channels, expected.image.numpy(), atol=1e-6)
    assert plain.render(camera, color=True).alpha.sum() > 1.5 * mip.render(camera, color=True).alpha.sum()
    # Values that are blended without colours, and votes, take other ways.
    ones = np.ones((len(small), 1), np.float32)
    np.testing.assert_allclose(mip.render(camera, channels=ones).alpha, 1 - expected.transmittance.numpy(), atol=1e-6)
    whole = np.ones((camera.height, camera.width, 1), np.float32)
    assert mip.votes(camera, whole).sum() == pytest.approx(float((1 - expected.transmittance).sum()), rel=1e-4)
