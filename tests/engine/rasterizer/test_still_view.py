from __future__ import annotations

import numpy as np
import pytest
import torch

from engine.errors import CameraError, NumericalError
from engine.rasterizer.api import rasterize
from engine.rasterizer.still_view import StillView
from tests.engine.rasterizer.scenes import camera, random_scene

SCENE = random_scene(400, colored=False)
ARRAYS = tuple(tensor.numpy() for tensor in (SCENE.means, SCENE.quats, SCENE.scales, SCENE.opacities))


def test_pictures_have_the_same_bits_as_rendered_anew() -> None:
    view, rng = camera(70, 50), np.random.default_rng(0)
    still = StillView(*ARRAYS, view)
    for n_channels in (1, 5, 16):
        channels = rng.normal(size=(400, n_channels)).astype(np.float32)
        image, transmittance = still.blend(channels)
        anew = rasterize(*map(torch.from_numpy, ARRAYS), camera=view, channels=torch.from_numpy(channels))
        np.testing.assert_array_equal(image, anew.image.numpy())
        np.testing.assert_array_equal(transmittance, anew.transmittance.numpy())


@pytest.mark.parametrize("n_sets", [1, 2, 6])
@pytest.mark.parametrize("after_a_picture", [True, False])
def test_votes_are_the_gradient_of_the_picture(n_sets: int, after_a_picture: bool) -> None:
    view = camera(70, 50)
    still = StillView(*ARRAYS, view)
    if after_a_picture:
        still.blend(np.ones((400, 3), np.float32))
    weights = np.random.default_rng(1).random((50, 70, n_sets), np.float32)
    channels = torch.zeros(400, n_sets, requires_grad=True)
    rasterize(*map(torch.from_numpy, ARRAYS), camera=view, channels=channels).image.backward(torch.from_numpy(weights))
    assert channels.grad is not None
    # Both sum a Gaussian's tiles in float64, in the same order.
    np.testing.assert_array_equal(still.votes(weights), channels.grad.numpy())
    np.testing.assert_array_equal(still.votes(weights), channels.grad.numpy())


@pytest.mark.parametrize("corner", [(0, 0), (20, 10), (33, 58)])
@pytest.mark.parametrize("after_a_picture", [True, False])
def test_votes_of_few_pixels_are_the_gradient_too(corner: tuple[int, int], after_a_picture: bool) -> None:
    view, (top, left) = camera(70, 50), corner
    still = StillView(*ARRAYS, view)
    if after_a_picture:
        still.blend(np.ones((400, 3), np.float32))
    weights = np.zeros((50, 70, 2), np.float32)
    weights[top : top + 12, left : left + 9, 1] = 0.5
    channels = torch.zeros(400, 2, requires_grad=True)
    rasterize(*map(torch.from_numpy, ARRAYS), camera=view, channels=channels).image.backward(torch.from_numpy(weights))
    assert channels.grad is not None and channels.grad.any()
    np.testing.assert_array_equal(still.votes(weights), channels.grad.numpy())
    assert not still.votes(np.zeros_like(weights)).any()


@pytest.mark.parametrize("after_a_picture", [True, False])
def test_the_share_of_some_gaussians_is_that_of_the_whole_picture(after_a_picture: bool) -> None:
    still, rng = StillView(*ARRAYS, camera(70, 50)), np.random.default_rng(2)
    if after_a_picture:
        still.blend(np.ones((400, 3), np.float32))
    for members in (rng.random(400) < 0.02, rng.random(400) < 0.5, np.ones(400, bool), np.zeros(400, bool)):
        shown = still.share(members)
        np.testing.assert_array_equal(shown, still.blend(members[:, None].astype(np.float32))[0][..., 0])
        assert shown.any() == members.any()


def test_nothing_in_the_picture_gets_no_vote() -> None:
    behind = (ARRAYS[0] * np.float32([1, 1, -1]), *ARRAYS[1:])
    still = StillView(*behind, camera(30, 20))
    assert not still.votes(np.ones((20, 30, 2), np.float32)).any()
    assert (still.blend(np.ones((400, 1), np.float32))[1] == 1).all()


def test_what_is_not_finite_is_named() -> None:
    bad = ARRAYS[0].copy()
    bad[3, 1] = np.nan
    with pytest.raises(NumericalError, match="means"):
        StillView(bad, *ARRAYS[1:], camera(30, 20))
    still = StillView(*ARRAYS, camera(30, 20))
    with pytest.raises(NumericalError, match="channels"):
        still.blend(np.full((400, 1), np.inf, np.float32))
    with pytest.raises(NumericalError):
        still.votes(np.full((20, 30, 1), np.nan, np.float32))
    with pytest.raises(CameraError):
        StillView(*ARRAYS, camera(0, 20))
