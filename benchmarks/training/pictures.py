"""Pictures of where the error is: test photo, rendered picture, error, and how many training photos see each place."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from engine.core.files import atomic_write
from engine.scene import CameraSet
from engine.training import load_gaussians
from engine.training.coverage import Coverage
from engine.training.held_out import render_picture
from engine.training.parameters import Parameters
from engine.training.settings import TrainingSettings
from engine.training.views import ViewPyramid, is_held_out, load_views

_FULL_ERROR = 0.3
"""Mean difference of the colours that is shown white."""
_MANY_PHOTOS = 6
"""Number of photos from which a place is shown white."""


def write_error_picture(project: Path, cameras: CameraSet, photos: Path, out: Path, *, n_rows: int = 3) -> None:
    """Write a PNG with a row for each of the first test photos.

    Parameters
    ----------
    project : Path
        Trained project.
    cameras : CameraSet
    photos : Path
    out : Path
    n_rows : int
    """
    settings = TrainingSettings().changed(train_features=False)
    views = load_views(photos, cameras, {}, settings)
    gaussians = load_gaussians(project / "gaussians")
    degree = int(round(gaussians.sh.shape[1] ** 0.5)) - 1
    values = Parameters.from_gaussians(gaussians, sh_degree=degree, features=False).values
    test = [i for i in range(len(views)) if is_held_out(i, settings.measurement.held_out_every)][:n_rows]
    coverage = Coverage(values, [view.pinhole for view in views if not view.held_out])
    pyramid, rows = ViewPyramid(views, settings.features), []
    for index in test:
        level = pyramid.level(index, 0)
        image = render_picture(values, level, backend=settings.backend, sh_degree=degree).numpy()
        error = np.abs(image - level.pixels / 255.0).mean(axis=2) / _FULL_ERROR
        seen = coverage.counts(level.camera) / _MANY_PHOTOS
        rows.append(np.hstack([level.pixels / 255.0, image, _grey(error), _grey(seen)]))
    width = max(row.shape[1] for row in rows)
    sheet = np.vstack([np.pad(row, ((0, 0), (0, width - row.shape[1]), (0, 0))) for row in rows])
    encoded = cv2.imencode(".png", (sheet[..., ::-1].clip(0, 1) * 255).round().astype(np.uint8))[1]
    with atomic_write(out) as stream:
        stream.write(encoded.tobytes())


def _grey(values: NDArray[np.floating]) -> NDArray[np.floating]:
    return np.repeat(values.clip(0, 1)[..., None], 3, axis=2)
