"""Optional features: gradients of the camera's pose, and antialiasing."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from engine.core.errors import CameraError
from engine.rasterizer.settings import RasterSettings

from .scenes import camera, random_scene
from .test_cpu_against_reference import assert_agree

SMALL = RasterSettings(antialiased=True)


def pose_gradient(backend: str, dtype: torch.dtype, settings: RasterSettings | None = None) -> torch.Tensor:
    scene, view = random_scene(200, n_features=5), camera(70, 53)
    viewmat = torch.tensor(view.viewmat, requires_grad=True)
    raster = scene.leaves(dtype).render(view, backend, settings, viewmat=viewmat)  # type: ignore[arg-type]
    weights = torch.randn(raster.image.shape, generator=torch.Generator().manual_seed(1)).to(dtype)
    ((raster.image * weights).sum() + raster.transmittance.sum()).backward()
    assert viewmat.grad is not None
    return viewmat.grad


@pytest.mark.parametrize("settings", [None, SMALL])
def test_gradient_of_the_pose_is_that_of_the_reference(settings: RasterSettings | None) -> None:
    ours = pose_gradient("cpu", torch.float32, settings)
    truth = pose_gradient("reference", torch.float64, settings)
    assert float(truth.norm()) > 1.0
    assert float((ours - truth).norm() / truth.norm()) <= 1e-4
    assert bool((ours[3] == 0).all())


def test_gradient_of_the_pose_is_that_of_finite_differences() -> None:
    scene, view = random_scene(30), camera(40, 30)
    viewmat = torch.tensor(view.viewmat, requires_grad=True)

    def loss(pose: torch.Tensor) -> torch.Tensor:
        image = scene.leaves(torch.float64).render(view, "reference", viewmat=pose).image  # type: ignore[arg-type]
        return (image * torch.linspace(-1, 1, image.numel(), dtype=torch.float64).reshape(image.shape)).sum()

    loss(viewmat).backward()
    assert viewmat.grad is not None
    for row, column in ((0, 0), (1, 2), (0, 3), (2, 3)):
        step = torch.zeros(4, 4, dtype=torch.float64)
        step[row, column] = 1e-7
        with torch.no_grad():
            slope = (loss(viewmat + step) - loss(viewmat - step)) / 2e-7
        torch.testing.assert_close(viewmat.grad[row, column], slope, rtol=1e-4, atol=1e-3)


def test_gradient_descent_recovers_a_pose() -> None:
    scene, view = random_scene(300), camera(60, 45)
    with torch.no_grad():
        target = scene.render(view).image
    offset = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    start = torch.tensor(view.viewmat)
    start[:3, 3] += torch.tensor([0.02, -0.015, 0.03])
    optimiser = torch.optim.Adam([offset], lr=2e-3)
    for _ in range(60):
        optimiser.zero_grad()
        pose = start + torch.nn.functional.pad(offset[:, None], (3, 0, 0, 1))
        image = scene.render(view, viewmat=pose).image  # type: ignore[arg-type]
        ((image - target) ** 2).mean().backward()
        optimiser.step()
    distance = (start[:3, 3] + offset.detach() - torch.tensor(view.viewmat[:3, 3])).norm()
    assert float(distance) <= 0.005


def test_no_gradient_is_computed_for_a_pose_that_does_not_require_it() -> None:
    scene, view = random_scene(50), camera(40, 30)
    given = scene.render(view, viewmat=torch.tensor(view.viewmat))  # type: ignore[arg-type]
    assert torch.equal(given.image, scene.render(view).image)
    assert not given.image.requires_grad


def test_a_pose_of_another_shape_or_not_finite_is_refused() -> None:
    scene, view = random_scene(5), camera(20, 20)
    with pytest.raises(ValueError, match="viewmat"):
        scene.render(view, viewmat=torch.eye(3))  # type: ignore[arg-type]
    with pytest.raises(CameraError, match="not finite"):
        scene.render(view, viewmat=torch.full((4, 4), torch.nan))  # type: ignore[arg-type]


@pytest.mark.parametrize("size", [0.07, 0.003])
def test_antialiased_images_and_gradients_agree(size: float) -> None:
    assert_agree(random_scene(300, n_features=3, size=size), camera(71, 50), settings=SMALL)


def test_antialiasing_keeps_the_light_of_a_gaussian_smaller_than_a_pixel() -> None:
    # Without antialiasing, the low pass widens a Gaussian to 0.3 pixels^2 at full opacity, however small it is.
    scene, view = random_scene(1, size=1.0), camera(41, 41, off_center=False)
    scene = replace(
        scene, means=torch.tensor([[0.2, -0.1, 3.0]]), quats=torch.tensor([[1.0, 0, 0, 0]]), opacities=torch.ones(1),
    )  # fmt: skip
    covered = []
    for sigma_px in (2.0, 0.5):
        scales = torch.full((1, 3), sigma_px * 3.3 / (0.9 * 41))
        raster = replace(scene, scales=scales).render(view, settings=SMALL)
        covered.append(float((1 - raster.transmittance).sum()))
    plain = replace(scene, scales=scales).render(view)
    assert covered[0] / covered[1] == pytest.approx(16.0, rel=0.15)
    assert float((1 - plain.transmittance).sum()) > 1.3 * covered[1]
