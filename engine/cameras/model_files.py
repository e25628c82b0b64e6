"""Check of the binary files of a COLMAP model: each must be as long as the counts in it say.

COLMAP does not notice the end of a file: it goes on with zeros, for as many records as a damaged count states.
"""

from __future__ import annotations

import mmap
import os
import struct
from collections.abc import Callable
from pathlib import Path

from ..core.errors import CameraError
from ..core.files import mapped, opened
from .colmap import pycolmap

_COUNT = struct.Struct("<Q")
_CAMERA = struct.Struct("<iiQQ")
_IMAGE_HEAD = struct.Struct("<i7di")
_POINT_2D_BYTES = 24
_POINT_HEAD = struct.Struct("<Q3d3BdQ")
_TRACK_ELEMENT_BYTES = 8
_RIG_HEAD = struct.Struct("<II")
_SENSOR_BYTES, _POSE_BYTES = 8, 56
_FRAME_HEAD = struct.Struct("<II7dI")
_DATA_ID_BYTES = 16

_REQUIRED = ("cameras.bin", "images.bin", "points3D.bin")


def require_whole_files(folder: Path, advice: str) -> None:
    """Raise an error when a binary file in `folder` is longer or shorter than its content says.

    Parameters
    ----------
    folder : Path
        Of a COLMAP model. A text model passes: COLMAP itself notices lines that are cut.
    advice : str
        One or more sentences: what the user should do about a damaged model.

    Raises
    ------
    CameraError
        When a file has another length.
    FormatError
        When a file cannot be read.
    """
    if not all((folder / name).exists() for name in _REQUIRED):
        return
    for name, end_of_record in _RECORDS.items():
        file = folder / name
        # Models of COLMAP before version 4 have neither rigs nor frames.
        if name not in _REQUIRED and not file.exists():
            continue
        with opened(file, advice=advice) as stream:
            size = stream.seek(0, os.SEEK_END)
        if size < _COUNT.size:
            raise CameraError(f"{file} ends too early. {advice}")
        with mapped(file, advice=advice) as data:
            end = _end(data, end_of_record)
            if end is None or end > len(data):
                raise CameraError(f"{file} ends too early. {advice}")
            if end < len(data):
                raise CameraError(f"{file} has {len(data) - end:,} bytes more than its content needs. {advice}")


def _end(data: mmap.mmap, end_of_record: Callable[[mmap.mmap, int], int]) -> int | None:
    """Return where the last record ends; None when a record begins after the end of the file."""
    (count,) = _COUNT.unpack_from(data)
    at = _COUNT.size
    try:
        for _ in range(count):
            at = end_of_record(data, at)
    # OverflowError: a damaged count leads further than an address can be.
    except (struct.error, OverflowError):
        return None
    return at


def _end_of_camera(data: mmap.mmap, at: int) -> int:
    _, model, _, _ = _CAMERA.unpack_from(data, at)
    # A model that COLMAP does not know is refused when COLMAP reads it.
    return at + _CAMERA.size + 8 * _N_PARAMETERS.get(model, 0)


def _end_of_image(data: mmap.mmap, at: int) -> int:
    end_of_name = data.find(b"\0", at + _IMAGE_HEAD.size)
    if end_of_name < 0:
        raise struct.error
    (count,) = _COUNT.unpack_from(data, end_of_name + 1)
    return int(end_of_name + 1 + _COUNT.size + _POINT_2D_BYTES * count)


def _end_of_point(data: mmap.mmap, at: int) -> int:
    (count,) = _COUNT.unpack_from(data, at + _POINT_HEAD.size - _COUNT.size)
    return int(at + _POINT_HEAD.size + _TRACK_ELEMENT_BYTES * count)


def _end_of_rig(data: mmap.mmap, at: int) -> int:
    _, count = _RIG_HEAD.unpack_from(data, at)
    at += _RIG_HEAD.size
    for number in range(count):
        at += _SENSOR_BYTES
        # The first sensor is the reference, all others may have a pose.
        if number > 0:
            (has_pose,) = struct.unpack_from("<B", data, at)
            at += 1 + (_POSE_BYTES if has_pose else 0)
    return at


def _end_of_frame(data: mmap.mmap, at: int) -> int:
    count = _FRAME_HEAD.unpack_from(data, at)[-1]
    return int(at + _FRAME_HEAD.size + _DATA_ID_BYTES * count)


_RECORDS: dict[str, Callable[[mmap.mmap, int], int]] = {
    "cameras.bin": _end_of_camera,
    "images.bin": _end_of_image,
    "points3D.bin": _end_of_point,
    "rigs.bin": _end_of_rig,
    "frames.bin": _end_of_frame,
}
_N_PARAMETERS = {
    int(model): len(pycolmap.Camera.create_from_model_id(1, model, 1.0, 1, 1).params)
    for model in pycolmap.CameraModelId.__members__.values()
    if model != pycolmap.CameraModelId.INVALID
}
