"""Cameras that RealityCapture and RealityScan export: CSV files, and an XMP file for each photo, in the same folder.

In both, focal lengths refer to film 36 mm wide, and principal points are offsets from the centre of the picture;
both are relative to the longest side in pixels. ``k1`` to ``k4``, ``t1`` and ``t2`` as in `brown_lens`: the
program's own export for OpenCV exchanges t1 and t2. XMP files have the rotation world-to-camera, row by row, with x
right, y down, z forward, and the position of the camera. CSV files have heading, pitch and roll in degrees: the
camera-to-world rotation Rz(-heading) Rx(pitch) Ry(roll), with x right, y up, z backward.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..core.arrays import Float64
from ..core.errors import CameraError
from ..core.files import read_bytes
from ..scene import MAX_COORDINATE, is_rotation
from .brown_lens import BrownLens
from .model_reading import write_model_arrays
from .safe_xml import numbers_of, parsed_xml

_CSV_ADVICE = (
    "Export the registration as Internal/External Camera Parameters (CSV) or as a COLMAP model, with the Brown3 "
    "distortion model and coordinates of a local Euclidean system."
)
_XMP_ADVICE = (
    "Export the metadata (XMP) again with camera positions and the Brown3 distortion model, or export a COLMAP model."
)
_FILM_MM = 36.0
_MAX_BYTES = 64 << 20
_LENS = ("k1", "k2", "k3", "k4", "t1", "t2")
_ALIASES = {"yaw": "heading", "z": "alt", "f_35mm": "f", "px_norm": "px", "py_norm": "py"}
_POSE = ("x", "y", "alt", "heading", "pitch", "roll")
_OPENGL = np.diag([1.0, -1.0, -1.0])
_RADIAL_MODELS = {"perspective": 0, "brown3": 3, "brown4": 4, "brown3t2": 5, "brown4t2": 6}


def reality_capture_lens(values: Mapping[str, float], width: int, height: int) -> BrownLens:
    """Return the lens of a picture of `width` x `height` for the values ``f``, ``px``, ``py``, ``k1``... of an
    export."""
    scale = max(width, height)
    focal = values["f"] * scale / _FILM_MM
    center = 0.5 * width + values.get("px", 0.0) * scale, 0.5 * height + values.get("py", 0.0) * scale
    k1, k2, k3, k4, t1, t2 = (values.get(name, 0.0) for name in _LENS)
    return BrownLens(width, height, focal, focal, *center, (k1, k2, k3, k4), (t1, t2))


def csv_in_child(source: str, target: str, what: str) -> dict[str, Any]:
    """Write the world-to-camera matrices of a CSV file to `target`; return names and lens values of its cameras.

    Parameters
    ----------
    source, target : str
        The CSV file, and the file for arrays.
    what : str
        For messages.

    Raises
    ------
    CameraError
        When the file is damaged, or has lenses or poses that cannot be used.
    """
    try:
        rows = _rows(read_bytes(Path(source), max_bytes=_MAX_BYTES, advice=_CSV_ADVICE))
        viewmats = [_viewmat_of_row(row) for _, row in rows]
    except (ValueError, csv.Error) as error:
        raise CameraError(f"{what} cannot be used: {error}. {_CSV_ADVICE}") from error
    lenses = [{name: value for name, value in row.items() if name not in _POSE} for _, row in rows]
    if any(lens.get("k1") for lens in lenses) and not any(lens.get(name) for lens in lenses for name in _LENS[1:]):
        # The file does not name the model. All models of Brown have several coefficients.
        raise CameraError(f"{what} cannot be used: its lenses have k1 only, as in the division model. {_CSV_ADVICE}")
    _write(target, viewmats)
    return {"images": [(name, index, "") for index, (name, _) in enumerate(rows)], "lenses": lenses}


def _rows(data: bytes) -> list[tuple[str, dict[str, float]]]:
    """Return name and numbers of each row; raises `ValueError` when columns are missing or are no numbers."""
    text = data.decode("utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#cameras")]
    if not lines:
        raise ValueError("it is empty")
    separator = max(",;\t", key=lines[0].count)
    table = csv.reader(io.StringIO("\n".join(lines)), delimiter=separator)
    header = [column.strip().lower().lstrip("#").strip() for column in next(table)]
    header = [_ALIASES.get(column, column) for column in header]
    missing = [name for name in ("name", *_POSE, "f") if name not in header]
    if missing:
        raise ValueError(f"it has no column {missing[0]}")
    wanted = {*_POSE, "f", "px", "py", *_LENS}
    rows = []
    for cells in table:
        values = dict(zip(header, cells, strict=False))
        if len(cells) < len(header):
            raise ValueError(f"the row of {values.get('name', '')} is too short")
        try:
            numbers = {name: float(values[name]) for name in wanted if name in values}
        except ValueError as error:
            raise ValueError(f"the row of {values['name']} has something that is no number") from error
        if not all(np.isfinite(list(numbers.values()))):
            raise ValueError(f"the row of {values['name']} has a number that is not finite")
        rows.append((values["name"].strip(), numbers))
    return rows


def _viewmat_of_row(row: Mapping[str, float]) -> Float64:
    heading, pitch, roll = np.radians([row["heading"], row["pitch"], row["roll"]])
    turned = _turn(2, -heading) @ _turn(0, pitch) @ _turn(1, roll)
    return _viewmat((turned @ _OPENGL).T, np.array([row["x"], row["y"], row["alt"]]))


def _turn(axis: int, angle: float) -> Float64:
    """Return the rotation [3, 3] around an axis by an angle in radians."""
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.eye(3)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    rotation[first, first], rotation[first, second] = c, -s
    rotation[second, first], rotation[second, second] = s, c
    return rotation


def _viewmat(rotation: Float64, position: Float64) -> Float64:
    if not (np.isfinite(rotation).all() and is_rotation(rotation)):
        raise ValueError("a rotation is scaled, skewed or mirrored")
    left, _, right = np.linalg.svd(rotation)
    viewmat = np.eye(4)
    viewmat[:3, :3] = left @ right
    viewmat[:3, 3] = -viewmat[:3, :3] @ position
    if not (np.abs(viewmat) <= MAX_COORDINATE).all():
        raise ValueError("a position is not finite or is too large")
    return viewmat


def _write(target: str, viewmats: Iterable[Float64]) -> None:
    stacked = np.array(list(viewmats)).reshape(-1, 4, 4)
    write_model_arrays(Path(target), np.zeros((0, 3)), np.zeros((0, 3), np.uint8), {"viewmats": stacked})


def xmp_in_child(source: list[str], target: str, what: str) -> dict[str, Any]:
    """Write the world-to-camera matrices of XMP files to `target`; return the lens values and parts of their cameras.

    Parameters
    ----------
    source : list of str
        The XMP files; those without a position are left out.
    target : str
        The file for arrays.
    what : str
        For messages.

    Raises
    ------
    CameraError
        When the file is damaged, or has lenses or poses that cannot be used.
    """
    images: list[tuple[str, int, str]] = []
    lenses: list[dict[str, float]] = []
    viewmats = []
    for file in source:
        values = _xmp_values(Path(file))
        if "Position" not in values or "Rotation" not in values:
            continue
        try:
            position, rotation = numbers_of(values["Position"], 3), numbers_of(values["Rotation"], 9)
            viewmats.append(_viewmat(np.array(rotation).reshape(3, 3), np.array(position)))
            lenses.append(_xmp_lens(values))
        except ValueError as error:
            raise CameraError(f"{file} cannot be used: {error}. {_XMP_ADVICE}") from error
        images.append((file, len(lenses) - 1, values.get("ComponentId", "")))
    if not images:
        raise CameraError(f"{what} cannot be used: no file has the position of a camera. {_XMP_ADVICE}")
    _write(target, viewmats)
    return {"images": images, "lenses": lenses}


def _xmp_values(file: Path) -> dict[str, str]:
    """Return the values of RealityCapture in an XMP file, which are attributes or elements."""
    values: dict[str, str] = {}
    for element in parsed_xml(file, _XMP_ADVICE).iter():
        if element.tag == "Description":
            values |= element.attrib
            values |= {child.tag: child.text or "" for child in element}
    return values


def _xmp_lens(values: Mapping[str, str]) -> dict[str, float]:
    """Return the lens values of an XMP file by their names in CSV files; raises `ValueError` for an unknown model."""
    model = values.get("DistortionModel", "perspective").lower()
    texts = values.get("DistortionCoeficients")
    coefficients = [0.0] * len(_LENS) if texts is None else numbers_of(texts, len(_LENS))
    if model not in _RADIAL_MODELS and any(coefficients):
        raise ValueError(f"its distortion model is {model}, which is not supported")
    if not float(values.get("Skew", 0)) == 0.0 or not float(values.get("AspectRatio", 1)) == 1.0:
        raise ValueError("its pixels are skewed or not square, which is not supported")
    numbers = {
        "f": float(values["FocalLength35mm"]) if "FocalLength35mm" in values else 0.0,
        "px": float(values.get("PrincipalPointU", 0)),
        "py": float(values.get("PrincipalPointV", 0)),
        **dict(zip(_LENS, coefficients, strict=True)),
    }
    if not (all(np.isfinite(list(numbers.values()))) and numbers["f"] > 0.0):
        raise ValueError("its focal length must be above 0 and all its lens values finite")
    return numbers
