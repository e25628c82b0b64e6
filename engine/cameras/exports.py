"""Cameras that other programs than COLMAP write: `read_export` returns them in one form, whatever their kind."""

from __future__ import annotations

import functools
import itertools
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import CameraError
from ..core.events import StopCheck
from ..scene import Lens, Photo
from .brown_lens import BrownLens
from .model_places import Export
from .model_reading import SparsePoints, in_child
from .orientation import GivenCamera
from .reality_capture import reality_capture_lens
from .transforms_json import frame_camera, read_transforms

_XML_BYTES = 24
"""Memory for each byte of an XML file as a tree. Measured: 12."""
_MAX_XMP_FILES = 20_000


@dataclass(frozen=True)
class ReadExport:
    """Cameras and points of an export.

    Attributes
    ----------
    parts : list of dict
        Makers of cameras by the name of the picture, for each part of the export: its parts have worlds of their own.
    labels : list of str
        A name of each part for messages.
    points : SparsePoints
        Of the only part.
    cloud : Path or None
        A file with the points instead.
    """

    parts: list[dict[str, Callable[[Photo], GivenCamera]]]
    labels: list[str]
    points: SparsePoints
    cloud: Path | None = None


def read_export(export: Export, model: Path, should_stop: StopCheck) -> ReadExport:
    """Return the cameras of an export.

    Parameters
    ----------
    model : Path
        What the user chose.

    Raises
    ------
    CameraError
        When the files are damaged, or have lenses that cannot be used.
    FormatError
        When a file cannot be opened.
    Cancelled
        When `should_stop` returned True.
    """
    file = export.files[0]
    if export.kind == "transforms":
        frames, cloud = read_transforms(file)
        makers = {name: _of_frame(values, name, file) for name, values in frames.items()}
        return ReadExport([makers], [""], SparsePoints.none(), cloud)
    called, function, lens_of = _READERS[export.kind]
    has_many_files = export.kind == "xmp"
    what, files = f"{called} {model if has_many_files else file}", export.files[:_MAX_XMP_FILES]
    source: Path | tuple[Path, ...] = files if has_many_files else file
    answer, arrays = in_child(function, source, files, what, should_stop, memory_per_byte=_XML_BYTES)
    folder = model if model.is_dir() else model.parent
    name_of: Callable[[str], str] = functools.partial(_photo_of_xmp, folder=folder) if has_many_files else str
    shown = np.split(arrays["seen"], np.cumsum(answer["seen"])) if "seen" in answer else ()
    read = _read(answer, arrays["viewmats"], name_of, lens_of, what, shown)
    return replace(read, points=SparsePoints(arrays["points"], arrays["colors"], math.nan))


def _photo_of_xmp(file: str, folder: Path) -> str:
    """Return the path of a photo without its suffix whose XMP file, in the same folder, is `file`."""
    return os.path.relpath(os.path.splitext(file)[0], folder)


def _of_frame(values: dict[str, Any], name: str, file: Path) -> Callable[[Photo], GivenCamera]:
    return lambda photo: frame_camera(values, name, photo, file)


_LensIn = tuple[Callable[[int, int], Lens], tuple[int, int] | None]
"""Maker of the lens in a picture of a width and a height, and the size of the picture that it is known in."""
_LensOf = Callable[[dict[str, Any], str, str], _LensIn]


def _read(
    answer: dict[str, Any],
    viewmats: NDArray[np.float64],
    name_of: Callable[[str], str],
    lens_of: _LensOf,
    what: str,
    shown: Sequence[NDArray[np.int64]] = (),
) -> ReadExport:
    parts: dict[str, dict[str, Callable[[Photo], GivenCamera]]] = {}
    nothing = itertools.repeat(np.zeros(0, np.int64))
    for (stored, lens, part), viewmat, seen in zip(answer["images"], viewmats, shown or nothing, strict=False):
        name, values = name_of(stored), answer["lenses"][lens]
        makers = parts.setdefault(part, {})
        if name in makers:
            raise CameraError(
                f"{what} has two cameras called {name}, which do not say which photo each is of. Give the photos "
                "different names and place them again, or export a COLMAP model."
            )
        makers[name] = _maker(name, viewmat, values, lens_of, what, seen)
    return ReadExport(list(parts.values()), list(parts), SparsePoints.none())


def _maker(
    name: str,
    viewmat: NDArray[np.float64],
    values: dict[str, Any],
    lens_of: _LensOf,
    what: str,
    seen: NDArray[np.int64],
) -> Callable[[Photo], GivenCamera]:
    def make(photo: Photo) -> GivenCamera:
        lens_in, size = lens_of(values, name, what)
        return GivenCamera(photo, name, viewmat, lens_in, size, seen)

    return make


def _of_sensor(values: dict[str, Any], name: str, what: str) -> _LensIn:
    if "problem" in values:
        raise CameraError(
            f"{what} cannot be used: {values['problem']}. Export the cameras as a COLMAP model instead (File > Export "
            "> Export Cameras > Colmap)."
        )
    brown = BrownLens(**{**values, "radial": tuple(values["radial"]), "tangential": tuple(values["tangential"])})
    lens = brown.as_lens()
    return (lambda *_: lens), (lens.width, lens.height)


def _of_values(values: dict[str, Any], name: str, what: str) -> _LensIn:
    def lens_in(width: int, height: int) -> Lens:
        try:
            return reality_capture_lens(values, width, height).as_lens()
        except ValueError as error:
            raise CameraError(
                f"{what} cannot be used: the camera of {name}: {error}. Export a COLMAP model instead."
            ) from error

    return lens_in, None


def _of_bundler(values: dict[str, Any], name: str, what: str) -> _LensIn:
    focal, k1, k2 = (float(values[key]) for key in ("f", "k1", "k2"))
    return (lambda w, h: Lens("RADIAL", w, h, (focal, 0.5 * w, 0.5 * h, k1, k2))), None


_READERS: dict[str, tuple[str, str, _LensOf]] = {
    "metashape": ("The Metashape export", "cameras.metashape:metashape_in_child", _of_sensor),
    "csv": ("The RealityCapture export", "cameras.reality_capture:csv_in_child", _of_values),
    "xmp": ("The XMP files in", "cameras.reality_capture:xmp_in_child", _of_values),
    "bundler": ("The Bundler file", "cameras.bundler:bundler_in_child", _of_bundler),
}
"""What messages call each kind of export, its reader for a child process, and what makes a lens of its values."""


def cameras_of(
    makers: dict[str, Callable[[Photo], GivenCamera]], found: dict[str, str], photos: Sequence[Photo]
) -> list[GivenCamera]:
    """Return the cameras of the names in `found`, which maps them to photos."""
    by_name = {photo.name: photo for photo in photos}
    return [makers[name](by_name[photo]) for name, photo in found.items()]
