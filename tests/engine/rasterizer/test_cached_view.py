"""A cached view gives the images and gradients of `rasterize`."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from engine.core.errors import CameraError, NumericalError
from engine.rasterizer.api import rasterize
from engine.rasterizer.cached_view import CachedView
from tests.engine.rasterizer.scenes import camera, random_scene

SCENE = random_scene(400, colored=False)
ARRAYS = tuple(tensor.numpy() for tensor in (SCENE.means, SCENE.quats, SCENE.scales, SCENE.opacities))


def test_images_have_the_same_bits_as_those_of_rasterize() -> None:
    view, rng = camera(70, 50), np.random.default_rng(0)
    cached = CachedView(*ARRAYS, view)
    for n_channels in (1, 5, 16):
        channels = rng.normal(size=(400, n_channels)).astype(np.float32)
        image, transmittance = cached.blend(channels)
        rendered = rasterize(*map(torch.from_numpy, ARRAYS), camera=view, channels=torch.from_numpy(channels))
        np.testing.assert_array_equal(image, rendered.image.numpy())
        np.testing.assert_array_equal(transmittance, rendered.transmittance.numpy())


@pytest.mark.parametrize("n_sets", [1, 2, 6])
@pytest.mark.parametrize("after_an_image", [True, False])
def test_votes_are_the_gradient_of_the_image(n_sets: int, after_an_image: bool) -> None:
    view = camera(70, 50)
    cached = CachedView(*ARRAYS, view)
    if after_an_image:
        cached.blend(np.ones((400, 3), np.float32))
    weights = np.random.default_rng(1).random((50, 70, n_sets), np.float32)
    channels = torch.zeros(400, n_sets, requires_grad=True)
    rasterize(*map(torch.from_numpy, ARRAYS), camera=view, channels=channels).image.backward(torch.from_numpy(weights))
    assert channels.grad is not None
    # Both sum a Gaussian's tiles in float64, in the same order.
    np.testing.assert_array_equal(cached.votes(weights), channels.grad.numpy())
    np.testing.assert_array_equal(cached.votes(weights), channels.grad.numpy())


@pytest.mark.parametrize("corner", [(0, 0), (20, 10), (33, 58)])
@pytest.mark.parametrize("after_an_image", [True, False])
def test_votes_of_few_pixels_are_the_gradient_too(corner: tuple[int, int], after_an_image: bool) -> None:
    view, (top, left) = camera(70, 50), corner
    cached = CachedView(*ARRAYS, view)
    if after_an_image:
        cached.blend(np.ones((400, 3), np.float32))
    weights = np.zeros((50, 70, 2), np.float32)
    weights[top : top + 12, left : left + 9, 1] = 0.5
    channels = torch.zeros(400, 2, requires_grad=True)
    rasterize(*map(torch.from_numpy, ARRAYS), camera=view, channels=channels).image.backward(torch.from_numpy(weights))
    assert channels.grad is not None and channels.grad.any()
    np.testing.assert_array_equal(cached.votes(weights), channels.grad.numpy())
    assert not cached.votes(np.zeros_like(weights)).any()


@pytest.mark.parametrize("after_an_image", [True, False])
def test_the_share_of_some_gaussians_is_that_of_the_whole_image(after_an_image: bool) -> None:
    cached, rng = CachedView(*ARRAYS, camera(70, 50)), np.random.default_rng(2)
    if after_an_image:
        cached.blend(np.ones((400, 3), np.float32))
    for members in (rng.random(400) < 0.02, rng.random(400) < 0.5, np.ones(400, bool), np.zeros(400, bool)):
        shown = cached.share(members)
        np.testing.assert_array_equal(shown, cached.blend(members[:, None].astype(np.float32))[0][..., 0])
        assert shown.any() == members.any()


def test_gaussians_outside_of_the_image_get_no_votes() -> None:
    behind = (ARRAYS[0] * np.float32([1, 1, -1]), *ARRAYS[1:])
    cached = CachedView(*behind, camera(30, 20))
    assert not cached.votes(np.ones((20, 30, 2), np.float32)).any()
    assert (cached.blend(np.ones((400, 1), np.float32))[1] == 1).all()


def test_arrays_that_are_not_finite_are_named() -> None:
    bad = ARRAYS[0].copy()
    bad[3, 1] = np.nan
    with pytest.raises(NumericalError, match="means"):
        CachedView(bad, *ARRAYS[1:], camera(30, 20))
    cached = CachedView(*ARRAYS, camera(30, 20))
    with pytest.raises(NumericalError, match="channels"):
        cached.blend(np.full((400, 1), np.inf, np.float32))
    with pytest.raises(NumericalError):
        cached.votes(np.full((20, 30, 1), np.nan, np.float32))
    with pytest.raises(CameraError):
        CachedView(*ARRAYS, camera(0, 20))
