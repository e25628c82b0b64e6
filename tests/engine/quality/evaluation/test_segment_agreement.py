"""Agreement of features with segments on a scene where the right answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from engine.quality.evaluation.segment_agreement import segment_agreement, untrained_features
from engine.scene.camera import PinholeCamera
from engine.scene.gaussians import Gaussians
from engine.training.views import TrainingView

CAMERA = PinholeCamera(np.eye(4), np.array([[40.0, 0, 32], [0, 40, 24], [0, 0, 1]]), 64, 48)


def two_walls() -> tuple[Gaussians, TrainingView]:
    """A wall at depth 2 that fills the picture: left half segment 1, right half segment 2."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-1.8, 1.8, 49), np.linspace(-1.3, 1.3, 36)))
    features = np.zeros((len(x), 16), np.float32)
    features[x < 0, 0] = features[x >= 0, 1] = 1
    walls = Gaussians(
        means=np.column_stack([x, y, np.full_like(x, 2.0)]).astype(np.float32),
        log_scales=np.full((len(x), 3), np.log(0.04), np.float32),
        quats=np.tile(np.float32([1, 0, 0, 0]), (len(x), 1)),
        opacity_logits=np.full(len(x), 4.0, np.float32),
        sh=np.zeros((len(x), 1, 3), np.float32),
        features=features,
    )
    labels = np.ones((48, 64), np.int32)
    labels[:, 32:] = 2
    return walls, TrainingView("a.jpg", CAMERA, np.zeros((48, 64, 3), np.uint8), labels, True)


def test_right_features_agree_and_random_ones_do_not() -> None:
    walls, view = two_walls()
    right = segment_agreement(walls, [view])
    # One column of pixels lies on the seam between the walls.
    assert right.mean_iou > 0.95
    assert right.n_segments == 2
    assert right.photos == {"a.jpg": right.mean_iou}
    assert segment_agreement(untrained_features(walls), [view]).mean_iou < 0.2


def test_one_feature_for_all_selects_everything() -> None:
    walls, view = two_walls()
    same = replace(walls, features=np.ones_like(walls.features))
    assert segment_agreement(same, [view]).mean_iou == pytest.approx(0.5, abs=0.01)


def test_length_of_features_does_not_matter() -> None:
    walls, view = two_walls()
    assert walls.features is not None
    longer = replace(walls, features=walls.features * 7)
    assert segment_agreement(longer, [view]).mean_iou == pytest.approx(
        segment_agreement(walls, [view]).mean_iou, abs=1e-3
    )


def test_pixels_that_nothing_covers_are_not_selected() -> None:
    walls, view = two_walls()
    left = walls[walls.means[:, 0] < 0]
    labels = view.labels.copy()
    labels[:, 32:] = 0
    assert segment_agreement(left, [replace(view, labels=labels)]).mean_iou > 0.95


def test_small_segments_and_photos_without_labels_are_passed_over() -> None:
    walls, view = two_walls()
    labels = view.labels.copy()
    labels[0, :5] = 9
    found = segment_agreement(walls, [replace(view, labels=labels), replace(view, photo="b.jpg", labels=None)])
    assert found.n_segments == 2
    assert np.isnan(segment_agreement(walls, []).mean_iou)


def test_gaussians_without_features_are_refused() -> None:
    walls, view = two_walls()
    with pytest.raises(ValueError, match="features"):
        segment_agreement(replace(walls, features=None), [view])
