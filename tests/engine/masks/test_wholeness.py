"""How whole segments look to SAM."""

from __future__ import annotations

import numpy as np
import pytest

from engine.masks.sam import Embedding
from engine.masks.settings import SAM_MODELS
from engine.masks.wholeness import features_of_segments, whole_odds


def embedding(height: int, width: int) -> Embedding:
    """The first channel of a cell is its row, the second its column, the third 1."""
    features = np.zeros((1, 256, 64, 64), np.float32)
    features[0, 0], features[0, 1] = np.mgrid[:64, :64]
    features[0, 2] = 1
    return Embedding(features, height, width, 1024 / max(height, width))


@pytest.mark.parametrize("reduced", [1, 2, 4])
def test_features_of_a_segment_are_the_mean_over_its_cells(reduced: int) -> None:
    labels = np.zeros((768, 1024), np.int32)
    labels[160:320, 320:640], labels[640:, :32], labels[0, 0] = 1, 2, 4
    found = features_of_segments(embedding(768, 1024), labels[::reduced, ::reduced])
    assert found.shape == (4, 256) and found.dtype == np.float32
    np.testing.assert_allclose(found[:, :3], [[14.5, 29.5, 1], [43.5, 0.5, 1], [0, 0, 0], [0, 0, 1]], atol=1e-4)
    assert not found[:, 3:].any()


@pytest.mark.parametrize(("height", "width"), [(640, 480), (480, 640), (1, 1), (3, 4000)])
def test_a_photo_of_any_shape_reaches_its_own_cells_alone(height: int, width: int) -> None:
    labels = np.ones((height, width), np.int32)
    (found,) = features_of_segments(embedding(height, width), labels)
    longest = max(height, width)
    cells = [(np.arange(side) + 0.5) * 64 // longest for side in (height, width)]
    np.testing.assert_allclose(found[:3], [cells[0].mean(), cells[1].mean(), 1], rtol=1e-5)


def test_photo_without_segments_has_no_log_odds() -> None:
    assert whole_odds(embedding(60, 80), np.zeros((60, 80), np.int32), SAM_MODELS[0]).shape == (0,)


def test_features_of_other_models_tell_nothing() -> None:
    labels = np.array([[1, 2], [0, 3]], np.int32)
    assert whole_odds(embedding(2, 2), labels, SAM_MODELS[0]).all()
    assert np.array_equal(whole_odds(embedding(2, 2), labels, SAM_MODELS[1]), np.zeros(3, np.float32))
