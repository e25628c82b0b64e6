"""Reading of a COLMAP model or a point cloud in a child process, because COLMAP loops and crashes on damaged files."""

from __future__ import annotations

import functools
import itertools
import logging
import math
import os
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.child_process import ChildFailure, run_in_child
from ..core.errors import CameraError
from ..core.events import StopCheck
from ..core.files import ArraySpec, atomic_write, opened, read_arrays
from ..core.system import native_path
from ..scene import MAX_COORDINATE, MAX_LENS_PARAMETER, MAX_PHOTO_SIDE, Lens
from . import colmap_calls as _quiet  # noqa: F401 silences COLMAP on import
from .colmap import pycolmap
from .model_files import require_whole_files
from .reconstruction import points_of, viewmat_of

_LOG = logging.getLogger(__name__)
_ADVICE = "Copy it again from where it was made, or let the cameras be estimated."
_MODEL_NAMES = ("cameras", "images", "points3D", "rigs", "frames")
_SMALLEST_MEMORY = 256 << 20
_MEMORY_PER_BYTE = 4
"""Memory for each byte of the files. Measured for a million points: 1.9, and 3.2 without tracks."""
_SMALLEST_SECONDS = 6.0
_BYTES_PER_SECOND = 5e6
"""Slowest reading that is waited for. Measured for a million points: 35 MB/s."""
_FAILURES = {
    "memory": "reading it takes more memory than files of this size need",
    "time": "reading it takes longer than files of this size need",
    "crash": "COLMAP crashed on it",
}
_QUATERNION_ERROR, _EXACT_QUATERNION_ERROR = 1e-2, 1e-6
"""Errors of a quaternion's length above which its file is damaged, and above which it is normalised."""
_MAX_HEADER_LINES = 1000
_MAX_SHOWN = 400
"""Points of a picture by which its orientation is found."""


@dataclass(frozen=True)
class ModelImage:
    """A registered picture of a model.

    Attributes
    ----------
    name : str
    lens : Lens
        In the picture's own pixels.
    viewmat : array of shape [4, 4], float64
        World-to-camera.
    seen : int array of shape [S]
        Indices of some of the points that it shows; empty when the model does not say it.
    """

    name: str
    lens: Lens
    viewmat: NDArray[np.float64]
    seen: NDArray[np.int64]


@dataclass(frozen=True)
class SparsePoints:
    """Positions [P, 3], sRGB colours [P, 3] and the mean reprojection error in pixels, NaN when unknown."""

    positions: NDArray[np.float64]
    colors: NDArray[np.uint8]
    reprojection_error: float

    @classmethod
    def none(cls) -> SparsePoints:
        """Return no points."""
        return cls(np.zeros((0, 3)), np.zeros((0, 3), np.uint8), math.nan)


def read_model(folder: Path, should_stop: StopCheck) -> tuple[list[ModelImage], SparsePoints]:
    """Return the registered pictures and the sparse points of the COLMAP model in `folder`.

    Parameters
    ----------
    folder : Path
        With ``cameras``, ``images`` and ``points3D``, all ``.bin`` or all ``.txt``.

    Raises
    ------
    CameraError
        When the model is incomplete or damaged, or takes more memory or time than files of its size can need.
    FormatError
        When a file cannot be opened.
    Cancelled
        When `should_stop` returned True.
    """
    files = [folder / f"{name}{suffix}" for name in _MODEL_NAMES for suffix in (".bin", ".txt")]
    answer, arrays = in_child(
        "cameras.model_reading:model_in_child", folder, files, f"The COLMAP model in {folder}", should_stop
    )
    lenses = {
        int(key): Lens(model, width, height, tuple(params))
        for key, (model, width, height, params) in answer["lenses"].items()
    }
    images = [
        ModelImage(name, lenses[lens], viewmat, arrays["seen"][start : start + count])
        for (name, lens, start, count), viewmat in zip(answer["images"], arrays["viewmats"], strict=True)
    ]
    error = math.nan if answer["error"] is None else answer["error"]
    return images, SparsePoints(arrays["points"], arrays["colors"], error)


def read_cloud(file: Path, should_stop: StopCheck) -> SparsePoints:
    """Return the points of a PLY file; raises as `read_model` does."""
    what = f"The point cloud {file} that belongs to the cameras"
    _, arrays = in_child("cameras.model_reading:cloud_in_child", file, [file], what, should_stop)
    return SparsePoints(arrays["points"], arrays["colors"], math.nan)


_ARRAYS = {"points": ArraySpec("float64", ("p", 3), finite=True), "colors": ArraySpec("uint8", ("p", 3))}
_OF_IMAGES = {"viewmats": ArraySpec("float64", ("i", 4, 4), finite=True), "seen": ArraySpec("int64", ("s",))}


def in_child(
    function: str,
    source: Path | Sequence[Path],
    files: Sequence[Path],
    what: str,
    should_stop: StopCheck,
    *,
    memory_per_byte: int = _MEMORY_PER_BYTE,
) -> tuple[Any, dict[str, NDArray[Any]]]:
    """Return the answer of a reader in a child process, and the arrays that it wrote.

    Parameters
    ----------
    function : str
        ``module:name`` below the engine's package, of a function with the arguments ``source``, ``target`` (the file
        for the arrays) and ``what``.
    source : Path or sequence of Path
        What the function reads.
    files : sequence of Path
        The files that it reads, which bound its memory and time.
    what : str
        A description for messages that begins with a capital letter.
    memory_per_byte : int
        Memory for each byte of the files.

    Raises
    ------
    CameraError
        When the files are damaged or take more memory or time than files of their size can need.
    FormatError
        When a file cannot be opened.
    Cancelled
        When `should_stop` returned True.
    """
    paths = [os.fspath(path.absolute()) for path in ([source] if isinstance(source, Path) else source)]
    n_bytes = sum(file.stat().st_size for file in files if file.is_file())
    with tempfile.TemporaryDirectory(prefix="gaussian-heritage-") as folder:
        target = Path(folder, "arrays.npz")
        try:
            answer = run_in_child(
                function,
                {"source": paths[0] if isinstance(source, Path) else paths, "target": os.fspath(target), "what": what},
                max_memory=_SMALLEST_MEMORY + memory_per_byte * n_bytes,
                max_seconds=_SMALLEST_SECONDS + n_bytes / _BYTES_PER_SECOND,
                what=f"reading {what[0].lower()}{what[1:]}",
                should_stop=should_stop,
            )
        except ChildFailure as error:
            _LOG.error("%s", error)
            raise _unreadable(what, _FAILURES[error.reason]) from error
        return answer, read_arrays(target, _ARRAYS, optional=_OF_IMAGES, advice="Run the command again.")


def _unreadable(what: str, why: str) -> CameraError:
    return CameraError(f"{what} cannot be read; it is incomplete or damaged ({why}). {_ADVICE}")


# ---- in the child process


def model_in_child(source: str, target: str, what: str) -> dict[str, Any]:
    """Write the arrays of a COLMAP model to `target`; return its lenses, picture names and reprojection error."""
    require_whole_files(Path(source), _ADVICE)
    return _translated(what, functools.partial(_converted, source, Path(target)))


def _converted(source: str, target: Path) -> dict[str, Any]:
    model = pycolmap.Reconstruction(str(native_path(Path(source))))
    images = [model.image(image_id) for image_id in model.reg_image_ids()]
    viewmats = np.array([_viewmat(image) for image in images]).reshape(-1, 4, 4)
    lenses = {image.camera_id: model.camera(image.camera_id) for image in images}
    for image in images:
        if problem := _lens_problem(lenses[image.camera_id]):
            raise ValueError(f"the camera of {image.name} {problem}")
    points, colors = points_of(model)
    names = _names_of_text_model(Path(source))
    shown = _shown_points(model, images, len(points))
    write_model_arrays(
        target, points, colors, {"viewmats": viewmats, "seen": np.concatenate([*shown, np.zeros(0, np.int64)])}
    )
    starts = np.cumsum([0, *map(len, shown)])
    # A text model may state -1 for errors that were not computed.
    error = model.compute_mean_reprojection_error() if len(points) else math.nan
    return {
        "lenses": {
            key: (lens.model_name, lens.width, lens.height, [float(value) for value in lens.params])
            for key, lens in lenses.items()
        },
        "images": [
            (names.get(image.image_id, image.name), image.camera_id, int(start), len(one))
            for image, start, one in zip(images, starts, shown, strict=False)
        ],
        "error": error if math.isfinite(error) else None,
    }


def _names_of_text_model(folder: Path) -> dict[int, str]:
    """Return the pictures' names of a text model by their ids: COLMAP cuts names at a blank. Empty for a binary one."""
    file = folder / "images.txt"
    if (folder / "images.bin").exists() or not file.exists():
        return {}
    names = {}
    with opened(file, advice=_ADVICE) as stream:
        lines = (line for line in stream if not line.startswith(b"#"))
        for line in lines:
            if line.strip():
                head = line.split(None, 9)
                if len(head) == 10:
                    names[int(head[0])] = head[9].rstrip(b"\r\n").decode()
                next(lines, None)  # the picture's features
    return names


def _shown_points(model: pycolmap.Reconstruction, images: list[pycolmap.Image], count: int) -> list[NDArray[np.int64]]:
    """Return, for each picture, rows of `points_of` that it shows, at most `_MAX_SHOWN`."""
    if not any(image.num_points3D for image in images):
        return [np.zeros(0, np.int64) for _ in images]
    row_of = {point_id: row for row, point_id in enumerate(sorted(model.point3D_ids()))}
    # A point that is not finite is in no row, and no row is known then.
    if len(row_of) != count:
        return [np.zeros(0, np.int64) for _ in images]
    shown = []
    for image in images:
        features = image.get_observation_point2D_idxs()
        step = max(1, len(features) // _MAX_SHOWN)
        rows = [row_of[image.point2D(feature).point3D_id] for feature in features[::step]]
        shown.append(np.array(rows, np.int64))
    return shown


def cloud_in_child(source: str, target: str, what: str) -> None:
    """Write the points of the PLY file `source` to `target`."""

    def convert() -> None:
        cloud = pycolmap.Reconstruction()
        cloud.import_PLY(source)
        stated, found = _stated_points(Path(source)), cloud.num_points3D()
        if stated != found:
            raise ValueError(f"it states {stated:,} points and has {found:,}")
        write_model_arrays(Path(target), *points_of(cloud))

    _translated(what, convert)


def _stated_points(file: Path) -> int:
    """Return the number of points in the header of a PLY file, which COLMAP has read without an error."""
    with opened(file, advice=_ADVICE) as stream:
        for line in itertools.islice(stream, _MAX_HEADER_LINES):
            if line.startswith(b"element vertex "):
                return int(line.split()[2])
    raise ValueError("its header states no points")


def _translated(what: str, convert: Callable[[], Any]) -> Any:
    try:
        return convert()
    # What pycolmap raises on damaged files; names that are not UTF-8 are a ValueError.
    except (RuntimeError, ValueError, IndexError, KeyError, TypeError, OSError) as error:
        raise _unreadable(what, _reason(error)) from error


def _reason(error: Exception) -> str:
    """Return the first line of an exception, unless it is source code of COLMAP."""
    line = (str(error).strip().splitlines() or [type(error).__name__])[0]
    return "a check of COLMAP failed" if "Check failed" in line or "::" in line else line.rstrip(".")


def write_model_arrays(
    target: Path,
    points: NDArray[np.float64],
    colors: NDArray[np.uint8],
    of_images: dict[str, NDArray[Any]] | None = None,
) -> None:
    """Write what `in_child` reads: points [P, 3] and colours [P, 3], without those too far away, and other arrays."""
    usable = (np.abs(points) <= MAX_COORDINATE).all(axis=1)
    arrays: dict[str, Any] = {"points": points[usable], "colors": colors[usable], **(of_images or {})}
    if "seen" in arrays and not usable.all():
        arrays["seen"] = np.zeros(0, np.int64)
    with atomic_write(target) as stream:
        np.savez(stream, **arrays)


def _viewmat(image: pycolmap.Image) -> NDArray[np.float64]:
    """Return the world-to-camera matrix [4, 4]; raises `ValueError` for a pose that no camera has."""
    viewmat = viewmat_of(image)
    quat = image.cam_from_world().rotation.quat
    length = float(np.linalg.norm(quat))
    if not abs(length - 1.0) <= _QUATERNION_ERROR:
        raise ValueError(f"the camera of {image.name} has no rotation")
    if not (np.abs(viewmat) <= MAX_COORDINATE).all():
        raise ValueError(f"the camera of {image.name} has a position that is not finite or is too large")
    if abs(length - 1.0) > _EXACT_QUATERNION_ERROR:
        # COLMAP does not normalise; a quaternion of few digits gives a matrix that is scaled.
        viewmat[:3, :3] = pycolmap.Rotation3d(quat / length).matrix()
    return viewmat


def _lens_problem(lens: pycolmap.Camera) -> str | None:
    if not (1 <= lens.width <= MAX_PHOTO_SIDE and 1 <= lens.height <= MAX_PHOTO_SIDE):
        return f"cannot have {lens.width} x {lens.height} pixels"
    if not (lens.verify_params() and (np.abs(lens.params) <= MAX_LENS_PARAMETER).all()):
        return "has lens parameters that are not finite or are too large"
    if not all(lens.params[index] > 0.0 for index in lens.focal_length_idxs()):
        return "has a focal length that is not above 0"
    return None
