"""The cpu backend gives the image and the gradients of the float64 reference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from engine.rasterizer.settings import ALPHA_MIN, RasterSettings
from engine.scene.camera import PinholeCamera

from .scenes import Scene, camera, gradients, random_scene


def relative_errors(ours: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Return the relative error of each row's norm; rows below a thousandth of the median norm are relative to that."""
    ours, truth = ours.double().reshape(len(ours), -1), truth.reshape(len(truth), -1)
    size = truth.norm(dim=1)
    floor = size[size > 0].median() * 1e-3 if bool((size > 0).any()) else torch.tensor(1.0)
    return (ours - truth).norm(dim=1) / size.clamp(min=float(floor))


def assert_agree(scene: Scene, view: PinholeCamera, **options: object) -> None:
    """Compare image and gradients by quantiles, because a pixel at a threshold may fall on either side of it."""
    ours, our_gradients = gradients(scene, view, torch.float32, "cpu", **options)
    truth, true_gradients = gradients(scene, view, torch.float64, "reference", **options)
    assert ours.culled == truth.culled
    assert torch.equal(ours.visible, truth.visible)
    torch.testing.assert_close(ours.radii.double(), truth.radii, rtol=1e-5, atol=1e-5)

    difference = (ours.image.double() - truth.image).abs().amax(dim=2)
    scale = float(truth.image.abs().max()) + 1e-30
    flips = int((difference > 1e-4 * scale).sum())
    assert float(difference.median()) <= 1e-6 * scale
    assert flips <= 1 + difference.numel() // 2000, f"{flips} of {difference.numel()} pixels differ"
    assert float(difference.max()) <= 2.0 * ALPHA_MIN * scale
    assert float((ours.transmittance.double() - truth.transmittance).abs().max()) <= 2.0 * ALPHA_MIN
    for name, gradient in our_gradients.items():
        errors = relative_errors(gradient, true_gradients[name])
        assert float(errors.median()) <= 1e-5, name
        assert float(errors.quantile(0.999)) <= 1e-3, name


@pytest.mark.parametrize(("colored", "n_features"), [(True, 0), (False, 1), (False, 16), (True, 16)])
def test_image_and_gradients_agree_for_any_number_of_channels(colored: bool, n_features: int) -> None:
    scene = random_scene(250, colored=colored, n_features=n_features)
    assert_agree(scene, camera(81, 50))


@pytest.mark.parametrize(("colored", "n_features"), [(True, 1), (True, 5), (True, 16), (False, 3)])
def test_detached_channels_learn_without_moving_gaussians(colored: bool, n_features: int) -> None:
    scene, view = random_scene(250, colored=colored, n_features=n_features), camera(81, 50)
    assert_agree(scene, view, detached_channels=True)
    _, joint = gradients(scene, view, torch.float32, "cpu")
    _, detached = gradients(scene, view, torch.float32, "cpu", detached_channels=True)
    assert torch.equal(joint["channels"], detached["channels"])
    assert not torch.equal(joint["means"], detached["means"])


@pytest.mark.parametrize(("width", "height"), [(1, 1), (17, 33), (3, 4097)])
def test_odd_image_sizes_agree(width: int, height: int) -> None:
    scene = random_scene(60, n_features=2, size=0.03 if height > 1000 else 0.1)
    assert_agree(scene, camera(width, height, focal=0.6 * max(width, height) + 1))


@pytest.mark.parametrize("opacity", [0.02, 0.5])
def test_hundreds_of_gaussians_over_each_pixel_agree_with_64_channels(opacity: float) -> None:
    """The lists are longer than one batch of the kernels, and some pixels finish in the middle, others never."""
    scene = random_scene(300, n_features=61, size=0.8)
    scene.opacities[:] = opacity
    assert_agree(scene, camera(20, 19))


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_unused_bands_of_harmonics_change_nothing_and_get_no_gradient(degree: int) -> None:
    scene = random_scene(60)
    assert scene.sh is not None
    view = camera(40, 30)
    used = (degree + 1) ** 2
    whole, found = gradients(scene, view, torch.float32, "cpu", sh_degree=degree)
    cut, expected = gradients(replace(scene, sh=scene.sh[:, :used]), view, torch.float64, "reference")
    torch.testing.assert_close(whole.image.double(), cut.image, rtol=0, atol=1e-5)
    assert not found["sh"][:, used:].any()
    assert float(relative_errors(found["sh"][:, :used], expected["sh"]).median()) <= 1e-5


def test_culled_gaussians_at_the_start_of_the_arrays_get_zero_gradients() -> None:
    scene = random_scene(80, n_features=3)
    view = camera(48, 32)
    for value in scene.tensors().values():
        value[:20] = value[20:40]
    scene.means[0:5, 2] = -2.0  # behind the camera
    scene.quats[5:10] = 0.0
    scene.opacities[10:15] = 0.5 * ALPHA_MIN
    scene.means[15:20, 0] = 40.0  # beside the image
    raster, found = gradients(scene, view, torch.float32, "cpu")
    assert not raster.visible[:20].any()
    assert min(raster.culled.near, raster.culled.degenerate, raster.culled.transparent) >= 5
    for name, gradient in found.items():
        assert not gradient[:20].any(), name
    assert_agree(scene, view)


def test_needles_and_screen_filling_and_subpixel_gaussians_agree() -> None:
    scene = random_scene(90, n_features=1)
    scene.scales[:30] *= torch.tensor([1e2, 1e-2, 1e-2])  # aspect 1:10^4
    scene.scales[30:60] *= 1e-3
    scene.scales[60:65] *= 30.0
    assert_agree(scene, camera(60, 40))


def test_opacity_one_and_equal_depths_agree() -> None:
    scene = random_scene(60)
    scene.opacities[:] = 1.0
    scene.means[:, 2] = 3.0
    facing = PinholeCamera(np.eye(4), np.array([[50.0, 0, 20], [0, 50, 15], [0, 0, 1]]), 40, 30)
    assert_agree(scene, facing)


def test_gaussians_just_behind_the_near_plane_and_far_outside_of_the_image_agree() -> None:
    scene = random_scene(120, n_features=1, size=0.02)
    scene.means[:60, 2] = torch.linspace(-0.28, -0.1, 60)  # 0.02 to 0.2 in front of the camera
    scene.means[:60, :2] *= 0.3
    scene.scales[60:] *= 20.0
    scene.means[60:, 0] += 3.0
    assert_agree(scene, camera(50, 40))


def test_huge_and_tiny_quaternions_agree() -> None:
    scene = random_scene(60)
    scene.quats[:20] *= 1e15
    scene.quats[20:40] *= 1e-6
    assert_agree(scene, camera(40, 30))


def test_values_of_any_size_neither_hang_nor_turn_into_nan() -> None:
    """Every finite float32 is a valid input. Gaussians that cannot be rendered are culled and counted."""
    rng = np.random.default_rng(0)
    scene = random_scene(400, n_features=1)
    for value, low, high in ((scene.means, -6, 12), (scene.quats, -12, 15), (scene.scales, -40, 38)):
        value *= torch.tensor(10.0 ** rng.uniform(low, high, (400, 1)), dtype=torch.float32).clamp(max=1e37)
    scene.opacities[::3] = 1.0
    scene.opacities[1::3] = torch.tensor(rng.choice([0.0, 1e-45, ALPHA_MIN], 133), dtype=torch.float32)
    for view in (camera(40, 30), camera(40, 30, focal=1e5)):
        raster, found = gradients(scene, view, torch.float32, "cpu")
        truth, _ = gradients(scene, view, torch.float64, "reference")
        assert raster.culled == truth.culled and raster.culled.degenerate > 0
        assert bool(torch.isfinite(raster.image).all())
        assert all(bool(torch.isfinite(gradient).all()) for gradient in found.values())


def test_gradients_flow_through_the_transmittance_alone() -> None:
    scene = random_scene(40)
    ours, truth = scene.leaves(torch.float32), scene.leaves(torch.float64)
    ours.render(camera(30, 30)).transmittance.sum().backward()
    truth.render(camera(30, 30), "reference").transmittance.sum().backward()
    assert ours.opacities.grad is not None and truth.opacities.grad is not None
    torch.testing.assert_close(ours.opacities.grad.double(), truth.opacities.grad, rtol=1e-4, atol=1e-4)


def test_a_gradient_at_a_few_pixels_only_agrees() -> None:
    scene = random_scene(80, n_features=16)
    view = camera(64, 48)
    found = []
    for dtype, backend in ((torch.float32, "cpu"), (torch.float64, "reference")):
        leaves = scene.leaves(dtype)
        image = leaves.render(view, backend).image
        image[20:24, 16:20, 3:].square().sum().backward()
        assert leaves.channels is not None and leaves.channels.grad is not None and leaves.means.grad is not None
        found.append((leaves.channels.grad, leaves.means.grad))
    for ours, truth in zip(*found, strict=True):
        assert truth.any()
        torch.testing.assert_close(ours.double(), truth, rtol=1e-3, atol=1e-4 * float(truth.abs().max()))


@pytest.mark.parametrize("backend", ["cpu", "reference"])
def test_no_gaussians_give_an_empty_image(backend: str) -> None:
    raster = random_scene(0).render(camera(20, 10), backend)
    assert not raster.image.any() and bool((raster.transmittance == 1).all())
    assert raster.culled.total == 0


def test_the_image_is_the_same_bit_for_bit_with_any_number_of_threads() -> None:
    scene = random_scene(300, n_features=5)
    view = camera(90, 70)
    one, one_gradients = gradients(scene, view, torch.float32, "cpu", settings=RasterSettings(threads=1))
    for threads in (2, 5):
        many, many_gradients = gradients(scene, view, torch.float32, "cpu", settings=RasterSettings(threads=threads))
        assert torch.equal(one.image, many.image) and torch.equal(one.transmittance, many.transmittance)
        for name, gradient in one_gradients.items():
            assert torch.equal(gradient, many_gradients[name]), name
