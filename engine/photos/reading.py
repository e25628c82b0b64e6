"""A folder of pictures becomes a `PhotoSet`: what can be used, and what cannot with the reason in one sentence."""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import Cancelled, PhotoError
from ..events import Emit, Progress, StopCheck, Warned, ignore_events, never_stop
from ..project_folder import file_sha256
from ..scene import Photo, PhotoSet, RejectedPhoto
from .exif import TURNS, orientation_of
from .photo_masks import with_masks
from .pixels import can_read_heic, open_photo, upright_pixels
from .settings import PhotoSettings

__all__ = ["picture_files", "read_photos"]

_LOG = logging.getLogger(__name__)

_STAGE = "photos"
_PICTURES = {".jpg", ".jpeg", ".jpe", ".jfif", ".png", ".tif", ".tiff", ".webp"}
_HEIC = {".heic", ".heif", ".hif"}
_RAW = {".cr2", ".cr3", ".nef", ".nrw", ".arw", ".dng", ".raf", ".orf", ".rw2", ".pef", ".srw", ".3fr", ".iiq"}
_VIDEO = {".mp4", ".mov", ".avi", ".mkv", ".m4v", ".insv"}
_OTHER_PICTURES = {".bmp", ".gif", ".avif", ".jxl", ".jp2", ".psd", ".exr", ".hdr"}

# Sharpness is measured at one size, so that cameras of different resolution compare.
_MEASURING_SIDE = 800


@dataclass(frozen=True)
class _Look:
    """What one decoded file showed."""

    photo: Photo
    pixels_hash: bytes
    sharpness: float
    flat: str | None


def read_photos(
    folder: Path,
    settings: PhotoSettings | None = None,
    *,
    masks: Path | None = None,
    emit: Emit = ignore_events,
    should_stop: StopCheck = never_stop,
) -> PhotoSet:
    """Return the usable photos in `folder` and its sub-folders, ordered by name, and the rejected files.

    Hidden files, files that are no pictures, and sub-folders that are Gaussian Heritage projects (they hold a
    ``project.json``) are passed over in silence. Raw files, videos and other pictures that cannot be read are listed
    as rejected, and so are damaged, tiny, blurred, black, white and repeated photos.

    Parameters
    ----------
    folder : Path
        The photo folder. Links to folders are not followed.
    settings : PhotoSettings, optional
        Bounds of what is used.
    masks : Path, optional
        Folder with the photos' masks, see `photo_masks`; what lies in it is no photo.
    emit : Emit
        Gets `Progress` per photo and one `Warned` per rejected file.
    should_stop : StopCheck
        Asked per photo.

    Returns
    -------
    PhotoSet
        With at least one photo.

    Raises
    ------
    PhotoError
        When the folder is missing, not a folder, a project, without pictures, or without a usable one; or the masks
        do not fit the photos.
    Cancelled
        When `should_stop` says so.

    Notes
    -----
    Every file is decoded once, which is the only way to find damage, on as many threads as there are cores; a
    12-megapixel JPEG costs about 0.25 s of CPU. Duplicates are files whose decoded, upright pixels are equal.
    """
    settings = settings or PhotoSettings()
    folder = folder.expanduser()
    files = picture_files(folder, without=masks)
    rejected = [RejectedPhoto(_name(folder, path), reason) for path in files if (reason := _unsupported(path))]
    candidates = [path for path in files if not _unsupported(path)]
    looks: list[_Look] = []
    for index, found in enumerate(_look_at_all(folder, candidates, settings, should_stop)):
        if isinstance(found, RejectedPhoto):
            rejected.append(found)
        else:
            looks.append(found)
        emit(Progress(_STAGE, (index + 1) / len(candidates), message=f"{index + 1} of {len(candidates)} photos"))
    for select in (_without_duplicates, _without_flat, lambda those: _without_blurred(those, settings)):
        looks, left_out = select(looks)
        rejected.extend(left_out)
    rejected.sort(key=lambda photo: photo.name)
    for photo in rejected:
        emit(Warned(f"{photo.name} is not used: {photo.reason}"))
    if not looks:
        why = f"{rejected[0].name}: {rejected[0].reason}" if rejected else ""
        raise PhotoError(f"None of the {len(files)} pictures in {folder} can be used. {why}")
    photos = tuple(look.photo for look in looks)
    if masks is not None:
        photos = with_masks(folder, photos, masks, emit=emit, should_stop=should_stop)
    return PhotoSet(folder, photos, tuple(rejected))


def picture_files(folder: Path, *, without: Path | None = None) -> list[Path]:
    """Return every file in `folder` that looks like a picture or a video, ordered by name; `read_photos` says which.

    Parameters
    ----------
    folder : Path
    without : Path, optional
        A folder inside that is passed over.

    Raises
    ------
    PhotoError
        When the folder is missing, not a folder, a project, cannot be read, or holds none.
    """
    if not folder.exists():
        raise PhotoError(f"The photo folder {folder} does not exist. Choose a folder with photos.")
    if not folder.is_dir():
        raise PhotoError(f"{folder} is a file. Choose the folder that holds the photos.")
    if (folder / "project.json").is_file():
        raise PhotoError(f"{folder} is a Gaussian Heritage project. Choose the folder that holds the photos.")
    left_out = None if without is None else without.resolve()
    known = _PICTURES | _HEIC | _RAW | _VIDEO | _OTHER_PICTURES
    found: list[Path] = []
    try:
        for place, folders, names in os.walk(folder, onerror=_raise):
            folders[:] = [
                name
                for name in folders
                if not name.startswith((".", "__MACOSX"))
                and not (Path(place, name) / "project.json").is_file()
                and Path(place, name).resolve() != left_out
            ]
            found += [
                Path(place, name) for name in names if not name.startswith(".") and Path(name).suffix.lower() in known
            ]
    except OSError as error:
        raise PhotoError(f"{error.filename} cannot be read: {error.strerror}. Check its permissions.") from error
    if not found:
        raise PhotoError(f"There are no photos in {folder}. Choose a folder with JPEG, PNG, TIFF, WebP or HEIC files.")
    return sorted(found, key=lambda path: _name(folder, path))


def _raise(error: OSError) -> None:
    raise error


def _name(folder: Path, path: Path) -> str:
    return path.relative_to(folder).as_posix()


def _unsupported(path: Path) -> str | None:
    suffix = path.suffix.lower()
    if suffix in _RAW:
        return "Raw camera files are not read; export it as JPEG or TIFF."
    if suffix in _VIDEO:
        return "Videos are not read; export its frames as JPEG."
    if suffix in _OTHER_PICTURES:
        return f"{suffix[1:].upper()} files are not read; save it as JPEG, PNG or TIFF."
    if suffix in _HEIC and not can_read_heic():
        return "HEIC files need the package pillow-heif; install it or save the photo as JPEG."
    return None


def _look_at_all(
    folder: Path, paths: list[Path], settings: PhotoSettings, should_stop: StopCheck
) -> Iterator[_Look | RejectedPhoto]:
    """Yield what each file showed, in order; files are decoded on all cores."""
    pool = ThreadPoolExecutor(max_workers=min(8, os.cpu_count() or 1))
    try:
        for found in pool.map(lambda path: _look_at(folder, path, settings), paths):
            yield found
            if should_stop():
                raise Cancelled("Reading the photos was stopped. Nothing was changed.")
    finally:
        pool.shutdown(cancel_futures=True)


def _look_at(folder: Path, path: Path, settings: PhotoSettings) -> _Look | RejectedPhoto:
    name = _name(folder, path)
    try:
        image, focal = open_photo(path)
        if min(image.size) < settings.min_side:
            return RejectedPhoto(
                name,
                f"It has only {image.width} x {image.height} pixels; {settings.min_side} on each side are the least.",
            )
        turned = orientation_of(image) in TURNS and orientation_of(image) >= 5
        pixels = upright_pixels(image)
        digest = file_sha256(path)
    except PhotoError as error:
        return RejectedPhoto(name, _as_reason(error, path))
    except OSError as error:
        return RejectedPhoto(name, f"The file cannot be read: {error.strerror or error}.")
    height, width = pixels.shape[:2]
    if turned and (width, height) != (image.height, image.width):
        raise AssertionError("a quarter turn must swap width and height")
    gray = _gray_for_measuring(pixels)
    return _Look(
        photo=Photo(name, width, height, focal, digest),
        pixels_hash=hashlib.blake2b(pixels.data, digest_size=16, key=f"{width}x{height}".encode()).digest(),
        sharpness=_sharpness(gray),
        flat=_flat(gray, settings.flat_share),
    )


def _as_reason(error: PhotoError, path: Path) -> str:
    """Return the error's words with the file's name, which stands beside the reason already, taken out."""
    message = str(error)
    for subject in (path.name, str(path)):
        if message.startswith(subject):
            return "It" + message[len(subject) :]
    return message


def _gray_for_measuring(pixels: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return the brightness [h, w], 0 to 255, box-averaged so that the longest side is near the measuring size."""
    step = max(1, round(max(pixels.shape[:2]) / _MEASURING_SIDE))
    height, width = (side // step * step for side in pixels.shape[:2])
    gray = pixels[:height, :width] @ np.array([0.299, 0.587, 0.114], dtype=np.float32)
    averaged: NDArray[np.float32] = gray.reshape(height // step, step, width // step, step).mean(axis=(1, 3))
    return averaged


def _sharpness(gray: NDArray[np.float32]) -> float:
    """Return the 99th percentile of the absolute Laplacian over the contrast (1st to 99th percentile).

    The percentile looks at the sharpest percent, so a sharp object before a plain or soft background counts as sharp.
    """
    laplacian = gray[:-2, 1:-1] + gray[2:, 1:-1] + gray[1:-1, :-2] + gray[1:-1, 2:] - np.float32(4.0) * gray[1:-1, 1:-1]
    dark, bright = np.percentile(gray, (1, 99))
    return float(np.percentile(np.abs(laplacian), 99) / max(bright - dark, 1.0))


def _flat(gray: NDArray[np.float32], share: float) -> str | None:
    if np.mean(gray > 8.0) < share:
        return "It is black; was the lens cap on?"
    if np.mean(gray < 247.0) < share:
        return "It is white: overexposed throughout."
    return None


_Selection = tuple[list[_Look], list[RejectedPhoto]]


def _split(looks: list[_Look], reason: Callable[[_Look], str | None]) -> _Selection:
    kept: list[_Look] = []
    left_out: list[RejectedPhoto] = []
    for look in looks:
        why = reason(look)
        if why is None:
            kept.append(look)
        else:
            left_out.append(RejectedPhoto(look.photo.name, why))
    return kept, left_out


def _without_duplicates(looks: list[_Look]) -> _Selection:
    first: dict[bytes, str] = {}

    def reason(look: _Look) -> str | None:
        original = first.setdefault(look.pixels_hash, look.photo.name)
        return None if original == look.photo.name else f"It is the same picture as {original}."

    return _split(looks, reason)


def _without_flat(looks: list[_Look]) -> _Selection:
    return _split(looks, lambda look: look.flat)


def _without_blurred(looks: list[_Look], settings: PhotoSettings) -> _Selection:
    """Leave out the few photos that are far less sharp than the set they belong to."""
    if len(looks) < settings.min_photos_for_blur or settings.blur_ratio == 0.0:
        return looks, []
    median = float(np.median([look.sharpness for look in looks]))
    soft = [look for look in looks if look.sharpness < settings.blur_ratio * median]
    at_most = max(1, int(settings.max_blurred_share * len(looks)))
    if len(soft) > at_most:
        _LOG.info("%d photos look soft; only the %d softest are left out", len(soft), at_most)
    out = {look.photo.name: look for look in sorted(soft, key=lambda look: look.sharpness)[:at_most]}

    def reason(look: _Look) -> str | None:
        if look.photo.name not in out:
            return None
        percent = round(100.0 * look.sharpness / median)
        return f"It is blurred: {percent} % as sharp as the median photo."

    return _split(looks, reason)
