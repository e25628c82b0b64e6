"""Pictures and votes of Gaussians that stay on a card: those of the processor, from any camera and of any size."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest
import torch

from engine.core.errors import CameraError, EnvironmentProblem, NumericalError
from engine.rasterizer.api import rasterize
from engine.rasterizer.gpu import Gpu, GpuScene
from engine.rasterizer.gpu import scene as gpu_scene
from engine.rasterizer.gpu.layout import Counts
from engine.scene.camera import PinholeCamera
from tests.engine.rasterizer.scenes import Scene, camera, random_scene

GAUSSIANS = random_scene(400)
VIEW = camera(70, 50)


def on_card(gpu: Gpu, given: Scene = GAUSSIANS) -> GpuScene:
    assert given.sh is not None
    tensors = (given.means, given.quats, given.scales, given.opacities, given.sh)
    return GpuScene(gpu, *(tensor.numpy() for tensor in tensors))


def on_processor(
    view: PinholeCamera, channels: np.ndarray | None, *, color: bool, given: Scene = GAUSSIANS
) -> tuple[np.ndarray, np.ndarray]:
    raster = rasterize(
        given.means, given.quats, given.scales, given.opacities, camera=view, sh=given.sh if color else None,
        channels=None if channels is None else torch.from_numpy(channels),
    )  # fmt: skip
    return raster.image.numpy(), raster.transmittance.numpy()


def votes_on_processor(view: PinholeCamera, weights: np.ndarray) -> np.ndarray:
    channels = torch.zeros(400, weights.shape[2], requires_grad=True)
    given = GAUSSIANS
    raster = rasterize(given.means, given.quats, given.scales, given.opacities, camera=view, channels=channels)
    raster.image.backward(torch.from_numpy(weights))
    assert channels.grad is not None
    return channels.grad.numpy()


def assert_near(found: np.ndarray, expected: np.ndarray) -> None:
    assert found.shape == expected.shape and found.dtype == np.float32
    difference, scale = np.abs(found - expected), max(1.0, float(np.abs(expected).max()))
    # Weights are rounded to 1e-7; a pixel on the boundary of a Gaussian changes by its smallest alpha, 1/255.
    assert np.quantile(difference, 0.999) <= 1e-4 * scale and difference.max() <= 1e-2 * scale


@pytest.mark.parametrize(
    ("n_channels", "color"), [(0, True), (1, False), (2, True), (5, False), (16, False), (70, True)]
)
def test_pictures_are_those_of_the_processor(n_channels: int, color: bool, opened_gpu: Gpu) -> None:
    scene = on_card(opened_gpu)
    channels = np.random.default_rng(0).normal(size=(400, n_channels)).astype(np.float32) if n_channels else None
    for view in (VIEW, camera(33, 90), VIEW):
        image, transmittance = scene.render(view, channels, color=color)
        shown = None if channels is None else channels[:, :50]  # as many as the processor renders at a time
        expected, rest = on_processor(view, shown, color=color)
        assert image.shape[2] == n_channels + 3 * color
        assert_near(image[..., : expected.shape[2]], expected)
        assert_near(transmittance, rest)
    if n_channels > 50:
        assert channels is not None
        assert_near(image[..., 53:], on_processor(VIEW, channels[:, 50:], color=False)[0])


@pytest.mark.parametrize("n_sets", [1, 3, 16, 70])
def test_votes_are_those_of_the_processor_and_repeat_their_bits(n_sets: int, opened_gpu: Gpu) -> None:
    scene, weights = on_card(opened_gpu), np.random.default_rng(1).random((50, 70, n_sets), np.float32)
    votes = scene.votes(VIEW, weights)
    first = votes_on_processor(VIEW, np.ascontiguousarray(weights[..., :60]))
    assert_near(votes[:, :60], first)
    scene.render(camera(40, 40), np.ones((400, 3), np.float32), color=True)
    np.testing.assert_array_equal(scene.votes(VIEW, weights), votes)
    np.testing.assert_array_equal(scene.votes(VIEW, weights), votes)
    np.testing.assert_array_equal(on_card(opened_gpu).votes(VIEW, weights), votes)


def test_votes_do_not_depend_on_what_was_rendered_before(opened_gpu: Gpu) -> None:
    """The buffers of colours then hold other values, some very large."""
    weights = np.random.default_rng(2).random((50, 70, 2), np.float32)
    scene = on_card(opened_gpu)
    scene.render(VIEW, np.full((400, 2), 3e38, np.float32))
    np.testing.assert_array_equal(scene.votes(VIEW, weights), on_card(opened_gpu).votes(VIEW, weights))
    assert not scene.votes(VIEW, np.zeros_like(weights)).any()


def test_share_is_the_picture_of_the_members(opened_gpu: Gpu) -> None:
    scene, rng = on_card(opened_gpu), np.random.default_rng(3)
    for members in (rng.random(400) < 0.1, np.ones(400, bool), np.zeros(400, bool)):
        shown = members.astype(np.float32)[:, None]
        np.testing.assert_array_equal(scene.share(VIEW, members), scene.render(VIEW, shown)[0][..., 0])
        assert_near(scene.share(VIEW, members), on_processor(VIEW, shown, color=False)[0][..., 0])


def test_a_camera_is_projected_once_for_pictures_in_succession(
    opened_gpu: Gpu, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs: list[object] = []
    forward = gpu_scene._Lists.forward
    monkeypatch.setattr(gpu_scene._Lists, "forward", lambda lists: (runs.append(lists), forward(lists)))
    scene, other = on_card(opened_gpu), camera(70, 50, off_center=False)
    for view in (VIEW, VIEW, other, VIEW):
        scene.render(view, np.ones((400, 1), np.float32))
        scene.votes(view, np.ones((50, 70, 2), np.float32))
    assert len(runs) == 3


def test_more_pairs_than_the_buffers_hold_grow_them(opened_gpu: Gpu) -> None:
    large = random_scene(300, size=1.5)
    view, channels = camera(200, 150), np.random.default_rng(4).random((300, 4), np.float32)
    scene = on_card(opened_gpu, large)
    scene.render(camera(16, 16), channels)
    before = scene._capacity
    image, _ = scene.render(view, channels)
    assert scene._capacity > before
    assert_near(image, on_processor(view, channels, color=False, given=large)[0])


def test_frames_of_few_sizes_are_kept(opened_gpu: Gpu) -> None:
    scene, views = on_card(opened_gpu), [camera(20 + 8 * i, 30) for i in range(gpu_scene.MAX_SIZES + 2)]
    first = scene.share(views[0], np.ones(400, bool))
    for view in views:
        scene.share(view, np.ones(400, bool))
    assert len(scene._frames) == gpu_scene.MAX_SIZES
    np.testing.assert_array_equal(scene.share(views[0], np.ones(400, bool)), first)


def test_memory_is_free_when_a_scene_is_dropped(opened_gpu: Gpu) -> None:
    scene = on_card(opened_gpu)
    scene.share(VIEW, np.ones(400, bool))
    buffer = weakref.ref(next(iter(scene._frames[70, 50].values())).buffers["entries"])
    gc.disable()
    try:
        del scene
        assert buffer() is None
    finally:
        gc.enable()


def test_values_that_are_not_finite_are_named(opened_gpu: Gpu) -> None:
    scene = on_card(opened_gpu)
    with pytest.raises(NumericalError, match="`channels` is not finite in 400 of 400 rows"):
        scene.render(VIEW, np.full((400, 3), np.nan, np.float32))
    with pytest.raises(NumericalError, match="`weights` is not finite"):
        scene.votes(VIEW, np.full((50, 70, 2), np.inf, np.float32))
    assert np.isfinite(scene.render(VIEW, color=True)[0]).all()
    bad = random_scene(400)
    bad.scales[7, 1] = np.nan
    for _ in range(2):
        with pytest.raises(NumericalError, match="`scales` is not finite in 1 of 400 rows"):
            on_card(opened_gpu, bad).votes(VIEW, np.ones((50, 70, 1), np.float32))
    assert bad.sh is not None
    bad.sh[9] = np.inf
    bad.scales[7, 1] = 0.1
    with pytest.raises(NumericalError, match="`sh` is not finite in 1 of 400 rows"):
        on_card(opened_gpu, bad).render(VIEW, color=True)


def test_impossible_requests_are_refused(opened_gpu: Gpu, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = on_card(opened_gpu)
    with pytest.raises(CameraError):
        scene.share(camera(0, 20), np.ones(400, bool))
    with pytest.raises(ValueError, match="at least one channel"):
        scene.render(VIEW)
    monkeypatch.setattr("engine.rasterizer.gpu.workspace.free_memory", lambda: 500_000)
    with pytest.raises(
        EnvironmentProblem, match=r"this picture of 300 x 200 pixels needs .*; render a smaller picture"
    ):
        scene.render(camera(300, 200), color=True)
    monkeypatch.undo()
    assert_near(scene.render(VIEW, color=True)[0], on_processor(VIEW, None, color=True)[0])
    counted = Counts(0, 2**31, 0)
    monkeypatch.setattr(gpu_scene._Lists, "counts", lambda _: counted)
    with pytest.raises(NumericalError, match="`scales` are so large"):
        scene.share(camera(10, 10), np.ones(400, bool))
