"""The undistorted photos, cameras, segments and sparse points of a set in one file, all that training needs."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from PIL import Image

from engine.core.files import ArraySpec, atomic_write, read_arrays
from engine.core.label_runs import LabelRuns
from engine.scene import CameraSet, PinholeCamera
from engine.training.views import TrainingView

_JPEG_QUALITY = 95
"""Keeps a set of 50 photos below 8 MB; the error of the photos is far below that of any training."""
_ARRAYS = {
    "points": ArraySpec("float32", ("p", 3), finite=True),
    "point_colors": ArraySpec("uint8", ("p", 3)),
    "viewmats": ArraySpec("float64", ("v", 4, 4), finite=True),
    "intrinsics": ArraySpec("float64", ("v", 3, 3), finite=True),
    "held_out": ArraySpec("bool", ("v",)),
    "photos": ArraySpec("str", ("v",)),
    "picture_ends": ArraySpec("int64", ("v",)),
    "pictures": ArraySpec("uint8", (-1,)),
}
_OPTIONAL = {"labels.*": ArraySpec("uint16", (-1, -1)), "valid.*": ArraySpec("bool", (-1, -1))}
"""Segments and masks of the views that have any, by their number."""
_ADVICE = "Make it again with `python -m benchmarks.training.card prepare`."


def write_views(file: Path, cameras: CameraSet, views: list[TrainingView]) -> None:
    """Write the views and sparse points of a set.

    Parameters
    ----------
    file : Path
        NPZ file.
    cameras : CameraSet
    views : list of TrainingView
    """
    pictures = []
    segments = {i: view.labels.array() for i, view in enumerate(views) if view.labels is not None}
    labels = {f"labels.{i}": one.astype(np.uint16) for i, one in segments.items()}
    masks = {f"valid.{i}": view.valid for i, view in enumerate(views) if view.valid is not None}
    for view in views:
        stream = io.BytesIO()
        Image.fromarray(view.pixels).save(stream, "JPEG", quality=_JPEG_QUALITY, subsampling=0)
        pictures.append(np.frombuffer(stream.getvalue(), np.uint8))
    with atomic_write(file) as out:
        np.savez_compressed(
            out,
            **labels,
            **masks,
            points=cameras.points,
            point_colors=cameras.point_colors,
            viewmats=np.stack([view.pinhole.viewmat for view in views]),
            intrinsics=np.stack([view.pinhole.K for view in views]),
            held_out=np.array([view.held_out for view in views]),
            photos=np.array([view.photo for view in views]),
            picture_ends=np.cumsum([len(picture) for picture in pictures]),
            pictures=np.concatenate(pictures),
        )


def read_views(file: Path) -> tuple[CameraSet, list[TrainingView]]:
    """Return what `write_views` wrote: sparse points in a `CameraSet` without cameras, and the views.

    Raises
    ------
    FormatError
        When the file cannot be read.
    """
    arrays = read_arrays(file, _ARRAYS, optional=_OPTIONAL, advice=_ADVICE)
    cameras = CameraSet((), (), arrays["points"], arrays["point_colors"], float("nan"), np.eye(4), False)
    views, begin = [], 0
    for i, end in enumerate(arrays["picture_ends"]):
        pixels = np.array(Image.open(io.BytesIO(arrays["pictures"][begin:end].tobytes())))
        pinhole = PinholeCamera(arrays["viewmats"][i], arrays["intrinsics"][i], pixels.shape[1], pixels.shape[0])
        labels = LabelRuns.of(arrays[f"labels.{i}"].astype(np.int32)) if f"labels.{i}" in arrays else None
        name, held_out = str(arrays["photos"][i]), bool(arrays["held_out"][i])
        views.append(TrainingView(name, pinhole, pixels, labels, held_out, arrays.get(f"valid.{i}")))
        begin = end
    return cameras, views
