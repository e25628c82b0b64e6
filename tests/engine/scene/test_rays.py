"""A ray through a pixel meets what the photo shows there."""

from __future__ import annotations

import numpy as np
import pytest

from engine.core.errors import CameraError
from engine.scene import Camera, Gaussians, RayCaster, photo_pixels, photo_ray, surface_point
from tests.engine.pictures.blob_scene import BlobScene

from .test_lens import PARAMETERS, camera_of


def gaussians_at(means: list[tuple[float, float, float]], opacities: list[float], scale: float = 0.1) -> Gaussians:
    count = len(means)
    opacity = np.array(opacities)
    return Gaussians(
        means=np.array(means, np.float32),
        log_scales=np.full((count, 3), np.log(scale), np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        opacity_logits=np.log(opacity / (1 - opacity)).astype(np.float32),
        sh=np.zeros((count, 1, 3), np.float32),
    )


def test_opacities_are_blended_front_to_back() -> None:
    caster = RayCaster(gaussians_at([(0, 0, 5), (0, 0, 2), (0, 3, 3), (0, 0, -1)], [0.5, 0.4, 0.9, 0.9]))
    hits = caster.cast(np.zeros(3), np.array([0, 0, 7.0]))
    assert hits.rows.tolist() == [1, 0]
    assert hits.distances == pytest.approx([2, 5])
    assert hits.weights == pytest.approx([0.4, 0.3])
    assert hits.opacity == pytest.approx(0.7)
    assert hits.surface == pytest.approx(5)


def test_light_that_passes_meets_no_surface() -> None:
    caster = RayCaster(gaussians_at([(0, 0, 5)], [0.4]))
    assert caster.cast(np.zeros(3), np.array([0, 0, 1.0])).surface is None
    assert caster.cast(np.zeros(3), np.array([0, 1.0, 0])).opacity == 0


def test_flat_turned_gaussian_is_met_where_its_density_is_highest() -> None:
    # A disc in the plane x + z = 4, which a ray along z from the origin crosses at (0, 0, 4).
    gaussians = gaussians_at([(1, 0, 3)], [0.9], scale=1.0)
    turn = np.radians(45.0) / 2
    gaussians.quats[0] = (np.cos(turn), 0, np.sin(turn), 0)
    gaussians.log_scales[0] = np.log([1.0, 1.0, 1e-4])
    hits = RayCaster(gaussians).cast(np.zeros(3), np.array([0, 0, 1.0]))
    assert hits.distances == pytest.approx([4.0], abs=1e-3)
    # The crossing is sqrt(2) standard deviations from its centre.
    assert hits.alphas == pytest.approx([0.9 * np.exp(-1.0)], rel=1e-3)


@pytest.mark.parametrize("model", sorted(PARAMETERS))
def test_ray_of_a_pixel_is_seen_at_that_pixel(model: str) -> None:
    camera = camera_of(model)
    for x, y in ((400.5, 300.5), (130.0, 90.0), (700.0, 520.0)):
        origin, direction = photo_ray(camera, x, y)
        assert np.array_equal(origin, np.zeros(3)) and np.linalg.norm(direction) == pytest.approx(1)
        # The search ends at a thousandth of a pixel.
        assert photo_pixels(camera, direction[None, :2] / direction[2])[0] == pytest.approx((x, y), abs=1e-3)


def test_pixel_that_the_lens_does_not_show_or_outside_of_the_photo_is_refused() -> None:
    with pytest.raises(CameraError, match="outside of a.jpg"):
        photo_ray(camera_of("PINHOLE"), 800.0, 10.0)
    turned_back = Camera("a.jpg", 800, 600, "SIMPLE_RADIAL", (610.0, 390.0, 310.0, -0.9), np.eye(4))
    with pytest.raises(CameraError, match="shows nothing"):
        photo_ray(turned_back, 2.0, 2.0)


def test_surface_of_a_ball_is_on_the_ball_and_empty_space_is_refused(blobs: BlobScene) -> None:
    camera = blobs.cameras.cameras[0]
    x, y = blobs.center_of(3, camera.photo)
    point = surface_point(RayCaster(blobs.gaussians), camera, x + 0.5, y + 0.5)
    # The blue ball has its middle at (0, 0.6, 0) and the radius 0.28; its Gaussians have the size 0.06.
    assert np.linalg.norm(np.subtract(point, (0, 0.6, 0))) == pytest.approx(0.28, abs=0.06)
    with pytest.raises(CameraError, match="shows no surface"):
        surface_point(RayCaster(blobs.gaussians[:1]), camera, x, y)
