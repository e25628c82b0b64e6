"""A scene on a graphics card gives the pictures and votes of the processor, which replaces a card that fails."""

from __future__ import annotations

import numpy as np
import pytest

from engine.core.errors import EnvironmentProblem, NumericalError
from engine.pictures.render import click_mask, render_view
from engine.pictures.scene import Scene
from engine.rasterizer.gpu import Gpu
from tests.engine.pictures.blob_scene import BLUE, RED, BlobScene, as_pinhole


def near(found: np.ndarray, expected: np.ndarray, scale: float = 1.0) -> bool:
    """Return whether values agree to 1e-4 in 99.9 %: weights are rounded, few pixels lie on a threshold of blending."""
    difference = np.abs(found - expected) / scale
    return found.shape == expected.shape and bool(np.quantile(difference, 0.999) < 1e-4 and difference.max() < 0.02)


@pytest.mark.parametrize(("color", "n_channels"), [(True, 0), (False, 16), (True, 70)])
def test_pictures_are_those_of_the_processor(color: bool, n_channels: int, card: Gpu, blobs: BlobScene) -> None:
    channels = np.random.default_rng(0).random((len(blobs.part), n_channels)) if n_channels else None
    on_card, on_processor = Scene(blobs.gaussians, backend="gpu"), Scene(blobs.gaussians)
    for camera in map(as_pinhole, blobs.cameras.cameras[:2]):
        found = on_card.render(camera, color=color, channels=channels)
        expected = on_processor.render(camera, color=color, channels=channels)
        assert near(found.channels, expected.channels) and near(found.alpha, expected.alpha)


def test_shares_and_votes_are_those_of_the_processor_and_repeat_their_bits(card: Gpu, blobs: BlobScene) -> None:
    on_card, on_processor = Scene(blobs.gaussians, backend="gpu"), Scene(blobs.gaussians)
    camera, members = as_pinhole(blobs.cameras.cameras[3]), blobs.part == RED
    labels = blobs.labels[blobs.cameras.cameras[3].photo]
    weights = np.dstack([labels == BLUE, np.ones_like(labels)])
    assert near(on_card.share(camera, members), on_processor.share(camera, members))
    votes, expected = on_card.votes(camera, weights), on_processor.votes(camera, weights)
    assert near(votes, expected, scale=float(expected.max()))
    np.testing.assert_array_equal(on_card.votes(camera, weights), votes)
    np.testing.assert_array_equal(Scene(blobs.gaussians, backend="gpu").votes(camera, weights), votes)


def test_mask_by_a_click_is_that_of_the_processor(card: Gpu, blobs: BlobScene) -> None:
    camera = blobs.cameras.cameras[0]
    x, y = blobs.center_of(BLUE, camera.photo)
    mask = click_mask(blobs.gaussians, camera, (x, y), backend="gpu")
    assert np.mean(mask != click_mask(blobs.gaussians, camera, (x, y))) <= 1e-3 and mask.any()
    nobody = np.zeros(len(blobs.gaussians), bool)
    assert not render_view(blobs.gaussians, camera, members=nobody, backend="gpu").any()


def test_processor_takes_over_from_a_card_that_is_too_small(
    card: Gpu, blobs: BlobScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    camera, weights = as_pinhole(blobs.cameras.cameras[0]), np.ones((120, 160, 1), np.float32)
    problems: list[EnvironmentProblem] = []
    scene = Scene(blobs.gaussians, backend="gpu", on_failure=problems.append)
    before = scene.votes(camera, weights)
    monkeypatch.setattr("engine.rasterizer.gpu.workspace.free_memory", lambda: 10_000)
    assert near(scene.render(camera, color=True).channels, Scene(blobs.gaussians).render(camera, color=True).channels)
    assert scene.backend == "cpu" and "render a smaller picture" in str(problems[0])
    after = scene.votes(camera, weights)
    np.testing.assert_array_equal(after, Scene(blobs.gaussians).votes(camera, weights))
    assert near(before, after, scale=float(after.max()))
    assert scene.with_gaussians(blobs.gaussians[:5]).backend == "cpu" and len(problems) == 1
    with pytest.raises(EnvironmentProblem, match="needs 0 MiB on"):
        Scene(blobs.gaussians, backend="gpu").votes(camera, weights)


def test_wrong_values_are_errors_and_no_reason_to_leave_the_card(card: Gpu, blobs: BlobScene) -> None:
    scene = Scene(blobs.gaussians, backend="gpu", on_failure=lambda problem: pytest.fail(str(problem)))
    camera = as_pinhole(blobs.cameras.cameras[0])
    with pytest.raises(NumericalError, match="`channels`"):
        scene.render(camera, channels=np.full((len(scene), 1), np.nan))
    assert scene.backend == "gpu"
