"""The gpu backend gives image and gradients of the float64 reference and of ``cpu``: a software adapter, or a card."""

from __future__ import annotations

import pytest
import torch

from engine.core.errors import EnvironmentProblem
from engine.rasterizer.gpu import Gpu
from engine.rasterizer.gpu import self_test as gpu_self_test
from engine.rasterizer.settings import ALPHA_MIN

from ..scenes import Scene, camera, gradients, random_scene
from ..test_cpu_against_reference import relative_errors


@pytest.mark.parametrize(
    ("colored", "n_features", "detached"), [(True, 0, False), (False, 1, False), (True, 16, False), (True, 5, True)]
)
def test_image_and_gradients_are_those_of_the_reference(colored: bool, n_features: int, detached: bool) -> None:
    agrees_with_reference(random_scene(250, colored=colored, n_features=n_features), detached)


@pytest.mark.parametrize("n_features", [1, 16, 64])
def test_gradients_of_large_gaussians_are_those_of_the_reference(n_features: int) -> None:
    """A batch then has more sums than there is room for; 64 features are more columns than a block has pixels."""
    agrees_with_reference(random_scene(250, colored=False, n_features=n_features, size=0.3), False)


def agrees_with_reference(scene: Scene, detached: bool) -> None:
    """Compare image and gradients with the float64 reference."""
    view = camera(81, 50)
    ours, found = gradients(scene, view, torch.float32, "gpu", detached_channels=detached)
    truth, expected = gradients(scene, view, torch.float64, "reference", detached_channels=detached)
    assert ours.culled == truth.culled and torch.equal(ours.visible, truth.visible)
    difference = (ours.image.double() - truth.image).abs().amax(dim=2)
    scale = float(truth.image.abs().max())
    assert float(difference.quantile(0.999)) <= 1e-5 * scale  # one pixel in 2000 may lie on a threshold
    for name, gradient in found.items():
        errors = relative_errors(gradient, expected[name])
        assert float(errors.median()) <= 1e-5, name
        # A pair on the threshold of alpha, 1/255, changes those behind it in that pixel by as much.
        assert float(errors.quantile(0.95)) <= 1e-3 and float(errors.quantile(0.98)) <= ALPHA_MIN, name


def agrees_with_cpu(n: int, width: int, height: int) -> None:
    """Compare the gpu backend with ``cpu`` by quantiles: both are float32, and single pixels lie on thresholds."""
    scene, view = random_scene(n, n_features=3), camera(width, height)
    ours, found = gradients(scene, view, torch.float32, "gpu")
    cpu, expected = gradients(scene, view, torch.float32, "cpu")
    assert ours.culled == cpu.culled and torch.equal(ours.visible, cpu.visible)
    difference = (ours.image - cpu.image).abs().amax(dim=2).flatten()
    assert float(difference.quantile(0.999)) <= 1e-5 * float(cpu.image.abs().max())
    assert float((ours.transmittance - cpu.transmittance).abs().flatten().quantile(0.999)) <= 1e-5
    for name, gradient in found.items():
        errors = relative_errors(gradient, expected[name])
        assert float(errors.median()) <= 1e-5, name
        assert float(errors.quantile(0.99)) <= 1e-3, name


def test_agrees_with_cpu_by_quantiles() -> None:
    agrees_with_cpu(500, 150, 90)


@pytest.mark.gpu
def test_a_card_agrees_with_cpu_by_quantiles() -> None:
    agrees_with_cpu(20_000, 640, 480)


def test_two_runs_give_the_same_bits() -> None:
    scene, view = random_scene(300, n_features=5), camera(90, 70)
    one, first = gradients(scene, view, torch.float32, "gpu")
    two, second = gradients(scene, view, torch.float32, "gpu")
    assert torch.equal(one.image, two.image) and torch.equal(one.transmittance, two.transmittance)
    assert all(torch.equal(first[name], second[name]) for name in first)


def test_more_pairs_than_the_buffers_hold_grow_them() -> None:
    scene = random_scene(2000, size=0.5)
    ours, truth = scene.render(camera(200, 150), "gpu"), scene.render(camera(200, 150))
    assert float((ours.image - truth.image).abs().quantile(0.999)) <= 1e-4


def test_a_card_that_computes_wrongly_is_refused(opened_gpu: Gpu, monkeypatch: pytest.MonkeyPatch) -> None:
    original = gpu_self_test.rasterize_cpu

    def wrong(inputs: object) -> object:
        raster = original(inputs)  # type: ignore[arg-type]
        return raster.__class__(raster.image * 1.01, raster.transmittance, raster.visible, raster.radii, raster.culled)

    monkeypatch.setattr(gpu_self_test, "rasterize_cpu", wrong)
    with pytest.raises(EnvironmentProblem, match="computes a test picture wrongly"):
        gpu_self_test.check_gpu(opened_gpu)
