"""Camera poses supplied by the user: a COLMAP model, or a ``transforms.json`` of nerfstudio or instant-ngp.

Conventions at input: COLMAP poses are world-to-camera with x right, y down, z forward; those of ``transforms.json`` are
converted in `transforms_json`. Units and world axes of the model are arbitrary and are normalised.
"""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import TypeVar

from ..errors import CameraError, FormatError
from ..events import Emit, StopCheck, ignore_events, never_stop
from ..scene import Camera, CameraSet, Photo, PhotoSet, camera_problem
from .colmap import pycolmap
from .model_reading import SparsePoints, read_cloud, read_model
from .reconstruction import camera_in_photo, camera_set, is_scaled
from .settings import CameraSettings
from .transforms_json import read_transforms, read_transforms_json
from .triangulation import triangulate
from .undistortion import require_valid_lens

__all__ = ["has_points", "match_photos", "read_cameras"]

Key = TypeVar("Key")
Value = TypeVar("Value")

_LOG = logging.getLogger(__name__)
_MODEL_FILES = ("cameras.bin", "cameras.txt")


def read_cameras(
    model: Path,
    photo_set: PhotoSet,
    settings: CameraSettings | None = None,
    *,
    folder: Path | None = None,
    emit: Emit = ignore_events,
    should_stop: StopCheck = never_stop,
) -> CameraSet:
    """Return the cameras of an existing model for the photos in `photo_set`, in the normalised world.

    Parameters
    ----------
    model : Path
        Folder of a COLMAP model (``cameras``, ``images``, ``points3D`` as ``.bin`` or ``.txt``, in this folder,
        ``sparse/0``, ``sparse`` or ``0``), a ``transforms.json``, or a folder with one.
    photo_set : PhotoSet
        Photos of the model, identified by `match_photos`.
    settings : CameraSettings, optional
        Settings of the matching that a model without points requires.
    folder : Path, optional
        Work folder for this matching; by default a temporary one.
    emit : Emit
        Used only for this matching.
    should_stop : StopCheck

    Returns
    -------
    CameraSet
        ``original_from_world`` maps to the frame of the model in the file, which may be georeferenced. Cameras of a
        COLMAP model of resized copies are scaled to the photos.

    Raises
    ------
    CameraError
        When the model is missing or cannot be read, or when its pictures are not the photos or are rotated differently.
    FormatError
        When a file of the model cannot be opened, or ``transforms.json`` is not what its format demands.
    Cancelled
        When `should_stop` returned True.

    Notes
    -----
    ``applied_transform`` and ``applied_scale`` of nerfstudio are ignored: the original frame is that of the poses in
    the file. When a model has no points, points are triangulated from matched features with the given poses fixed.
    """
    colmap = _colmap_folder(model)
    if colmap is not None:
        cameras, points = _from_colmap(colmap, photo_set, should_stop)
    else:
        cameras, cloud = read_transforms(_transforms_file(model), photo_set, match_photos)
        points = SparsePoints.none() if cloud is None else read_cloud(cloud, should_stop)
    _require_usable_cameras(cameras, model)
    if len(points.positions) == 0 and len(cameras) >= 2:
        points = _triangulated(cameras, photo_set, settings or CameraSettings(), folder, emit, should_stop)
    return camera_set(
        cameras,
        (photo.name for photo in photo_set.photos),
        points.positions,
        points.colors,
        reprojection_error=points.reprojection_error,
        poses_given=True,
    )


def has_points(model: Path) -> bool:
    """Return whether a model appears to have sparse points, without reading them.

    Raises
    ------
    CameraError
        When the model is missing.
    """
    if _colmap_folder(model) is not None:
        return True
    try:
        return bool(read_transforms_json(_transforms_file(model)).get("ply_file_path"))
    except FormatError:
        return False  # `read_cameras` reports the error.


def match_photos(names: Iterable[str], photo_set: PhotoSet) -> dict[str, Photo]:
    """Return the photo of each picture name of a model: equal relative names first, then equal unique file names.

    Names without an extension, as in the NeRF synthetic scenes, match a photo's name without its extension. A photo is
    assigned to one picture only, the one that matches better.
    """
    names = [name.replace("\\", "/").removeprefix("./") for name in names]
    steps = (
        (lambda name: name, lambda name: name),
        (lambda name: name, lambda name: _without_suffix(name)),
        (lambda name: name.rsplit("/", 1)[-1], lambda name: name.rsplit("/", 1)[-1]),
        (lambda name: name.rsplit("/", 1)[-1], lambda name: _without_suffix(name.rsplit("/", 1)[-1])),
    )
    found: dict[str, Photo] = {}
    for of_picture, of_photo in steps:
        assigned = {photo.name for photo in found.values()}
        pictures = _unique((of_picture(name), name) for name in names if name not in found)
        photos = _unique((of_photo(photo.name), photo) for photo in photo_set.photos if photo.name not in assigned)
        for key, name in pictures.items():
            if key in photos:
                found[name] = photos[key]
    return found


def _without_suffix(name: str) -> str:
    head, dot, tail = name.rpartition(".")
    return head if dot and "/" not in tail else name


def _unique(pairs: Iterable[tuple[Key, Value]]) -> dict[Key, Value]:
    """Return the pairs whose key occurs only once."""
    found: dict[Key, Value] = {}
    repeated: set[Key] = set()
    for key, value in pairs:
        if key in found:
            repeated.add(key)
        found[key] = value
    return {key: value for key, value in found.items() if key not in repeated}


def _colmap_folder(model: Path) -> Path | None:
    for candidate in (model, model / "sparse" / "0", model / "sparse", model / "0"):
        if any((candidate / name).is_file() for name in _MODEL_FILES):
            return candidate
    return None


def _transforms_file(model: Path) -> Path:
    for candidate in (model, model / "transforms.json"):
        if candidate.is_file():
            return candidate
    if not model.exists():
        raise CameraError(f"The camera model {model} does not exist. Choose a COLMAP model folder or transforms.json.")
    raise CameraError(
        f"{model} contains no camera model. Choose a COLMAP model folder (cameras.bin, images.bin, points3D.bin) or a "
        "transforms.json."
    )


def _from_colmap(folder: Path, photo_set: PhotoSet, should_stop: StopCheck) -> tuple[list[Camera], SparsePoints]:
    found, points = read_model(folder, should_stop)
    images = {image.name.replace("\\", "/").removeprefix("./"): image for image in found}
    matched = match_photos(images, photo_set)
    ignored = sorted(set(images) - set(matched))
    if ignored:
        _LOG.info("%d pictures of %s are not among the photos: %s", len(ignored), folder, ", ".join(ignored))
    cameras = []
    for name, photo in matched.items():
        model, width, height, params = images[name].lens
        _require_same_frame(photo, width, height, folder)
        lens = pycolmap.Camera(model=model, width=width, height=height, params=list(params))
        cameras.append(camera_in_photo(photo.name, lens, photo.width, photo.height, images[name].viewmat))
    return cameras, points


def _require_same_frame(photo: Photo, width: int, height: int, model: Path) -> None:
    """Raise `CameraError` when the picture of a camera cannot be the photo at another size."""
    if is_scaled((width, height), (photo.width, photo.height)):
        return
    if (width > height) != (photo.width > photo.height):
        advice = "it was made without EXIF rotation. Rotate the photos themselves, or let the cameras be estimated."
    else:
        advice = "it was made from cropped or other pictures. Choose those pictures as the photo folder."
    raise CameraError(
        f"The camera of {photo.name} in {model} is for {width} x {height} pixels, the photo has "
        f"{photo.width} x {photo.height}: {advice}"
    )


def _require_usable_cameras(cameras: list[Camera], model: Path) -> None:
    if not cameras:
        raise CameraError(
            f"None of the pictures in {model} is among the photos. Choose the photo folder the model was made from."
        )
    for camera in cameras:
        require_valid_lens(camera.lens)
        if problem := camera_problem(camera):
            raise CameraError(
                f"The camera of {camera.photo} in {model} cannot be used, because {problem}. Correct it, or let the "
                "cameras be estimated."
            )


def _triangulated(
    cameras: list[Camera],
    photo_set: PhotoSet,
    settings: CameraSettings,
    folder: Path | None,
    emit: Emit,
    should_stop: StopCheck,
) -> SparsePoints:
    if folder is not None:
        return SparsePoints(*triangulate(cameras, photo_set, folder, settings, emit=emit, should_stop=should_stop))
    with tempfile.TemporaryDirectory(prefix="gaussian-heritage-") as temporary:
        return _triangulated(cameras, photo_set, settings, Path(temporary), emit, should_stop)
