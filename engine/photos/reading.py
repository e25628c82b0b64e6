"""Read a folder of pictures as a `PhotoSet`: the usable photos, and the rejected files with one reason each."""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..core.errors import Cancelled, PhotoError
from ..core.events import Emit, Progress, StopCheck, Warned, ignore_events, never_stop
from ..core.files import file_sha256
from ..core.visible_text import visible
from ..scene import Photo, PhotoSet, RejectedPhoto
from .bounded import call_within_bounds
from .copies import ComparedPhoto, copies_among, summary_of_copies
from .exif import capture_time, orientation_of
from .kinds import PICTURES, has_suffix_of_picture, kind_of_file, live_photo_of, refusal_of
from .look import GRAY_WEIGHTS, Look, LookBuilder
from .mask_pictures import masks_among, summary_of_masks
from .names import problem_of_name, require_utf8_folder
from .photo_masks import with_masks
from .pixels import open_photo, read_header, upright_strips
from .projection import FISHEYE_PICTURE, Circle, circle_of, fisheye_photos, unusual_picture
from .settings import PhotoSettings
from .skipped_folders import is_skipped_folder

_LOG = logging.getLogger(__name__)

_STAGE = "photos"

# Longest side in pixels at which sharpness is measured, so that cameras of different resolution can be compared.
_MEASURING_SIDE = 800


@dataclass(frozen=True)
class _DecodedPhoto:
    """Measurements of one decoded file."""

    photo: Photo
    compared: ComparedPhoto
    sharpness: float
    flat_reason: str | None
    unusual_reason: str | None
    circle: Circle | None


def read_photos(
    folder: Path,
    settings: PhotoSettings | None = None,
    *,
    masks: Path | None = None,
    emit: Emit = ignore_events,
    should_stop: StopCheck = never_stop,
) -> PhotoSet:
    """Return the usable photos in `folder` and its sub-folders, ordered by name, and the rejected files.

    The content of a file says what it is, not its name. Hidden files and folders, folders of a system's own
    (`skipped_folders`), files that are not pictures, the moving parts of Live Photos, and sub-folders that are Gaussian
    Heritage projects (with a ``project.json``) are skipped without a warning. Raw files, videos and unsupported picture
    formats are listed as rejected, as are damaged, tiny, blurred, black and white photos, masks (`mask_pictures`),
    copies of other photos (`copies`), panoramas, fisheye pictures and screenshots, photos that would take too much
    memory, names that are not UTF-8, too long or have control characters, links that lead nowhere, pipes and
    sub-folders that cannot be read.

    Parameters
    ----------
    folder : Path
        The photo folder. Links to folders are not followed.
    settings : PhotoSettings, optional
        Criteria for rejecting a photo.
    masks : Path, optional
        Folder with the photos' masks, see `photo_masks`; the files in it are not read as photos.
    emit : Emit
        Receives a `Progress` per photo, one `Warned` about all copies, one about all masks, and one per rejected file.
    should_stop : StopCheck
        Called for each photo.

    Returns
    -------
    PhotoSet
        With at least one photo.

    Raises
    ------
    PhotoError
        When the folder is missing, not a folder, a project, without pictures, or without a usable photo; or when the
        masks do not match the photos.
    Cancelled
        When `should_stop` returns True.

    Notes
    -----
    Every file is decoded once, which is the only way to detect damage, on as many threads as there are cores. A JPEG of
    12 megapixels takes about 0.25 s of CPU. Memory and time are bounded, see `bounded`.
    """
    settings = settings or PhotoSettings()
    folder = folder.expanduser()
    files = picture_files(folder, without=masks)
    problems = {path: _unsupported(folder, path) for path in files}
    rejected = [_rejected(folder, path, reason) for path, reason in problems.items() if reason]
    candidates = [path for path, reason in problems.items() if not reason]
    decoded: list[_DecodedPhoto] = []
    for index, result in enumerate(_decode_all(folder, candidates, settings, should_stop)):
        if isinstance(result, RejectedPhoto):
            rejected.append(result)
        else:
            decoded.append(result)
        emit(Progress(_STAGE, (index + 1) / len(candidates), message=f"{index + 1} of {len(candidates)} photos"))
    summaries: list[str | None] = []
    selections: list[Callable[[list[_DecodedPhoto]], _Selection]] = [
        lambda photos: _without_masks(photos, summaries),
        lambda photos: _without_copies(photos, summaries),
        _without_flat,
        _without_unusual,
        *([] if settings.keep_fisheye else [_without_fisheye]),
        lambda photos: _without_blurred(photos, settings),
    ]
    for select in selections:
        decoded, rejected_now = select(decoded)
        rejected.extend(rejected_now)
    rejected.sort(key=lambda photo: photo.name)
    for sentence in (*filter(None, summaries), *(f"{photo.name} is not used: {photo.reason}" for photo in rejected)):
        emit(Warned(sentence))
    if not decoded:
        first_reason = f"{rejected[0].name}: {rejected[0].reason}" if rejected else ""
        raise PhotoError(f"None of the {len(files)} pictures in {folder} can be used. {first_reason}")
    photos = tuple(entry.photo for entry in decoded)
    if masks is not None:
        photos = with_masks(folder, photos, masks, emit=emit, should_stop=should_stop)
    return PhotoSet(folder, photos, tuple(rejected))


def picture_files(folder: Path, *, without: Path | None = None) -> list[Path]:
    """Return every file in `folder` that is a picture or a video by its content or its name, ordered by name.

    See `read_photos`. The moving parts of Live Photos are left out: a video in the folder of a photo of the same name.

    Sub-folders that cannot be read, and folders without pictures that are named like one, are among them.

    Parameters
    ----------
    without : Path, optional
        A folder inside `folder` that is skipped.

    Raises
    ------
    PhotoError
        When the folder is missing, not a folder, a project, unreadable, or without pictures, or when its name is not
        UTF-8.
    """
    if not folder.exists():
        raise PhotoError(f"The photo folder {folder} does not exist. Choose a folder with photos.")
    if not folder.is_dir():
        raise PhotoError(f"{folder} is a file. Choose the folder that contains the photos.")
    if (folder / "project.json").is_file():
        raise PhotoError(f"{folder} is a Gaussian Heritage project. Choose the folder that contains the photos.")
    require_utf8_folder(folder)
    skipped = None if without is None else os.path.realpath(without)
    files: list[Path] = []
    named_like_files: list[Path] = []

    def unreadable(error: OSError) -> None:
        if Path(error.filename) == folder:
            raise PhotoError(f"{folder} cannot be read: {error.strerror}. Check its permissions.") from error
        files.append(Path(error.filename))

    for parent, folders, names in os.walk(folder, onerror=unreadable):
        named_like_files += [Path(parent, name) for name in folders if has_suffix_of_picture(name)]
        folders[:] = [
            name
            for name in folders
            if not is_skipped_folder(Path(parent, name))
            and not os.path.isfile(Path(parent, name, "project.json"))
            and os.path.realpath(Path(parent, name)) != skipped
        ]
        files += _pictures_among(parent, [name for name in names if not name.startswith(".")])
    files += [path for path in named_like_files if not any(path in file.parents for file in files)]
    if not files:
        raise PhotoError(f"There are no photos in {folder}. Choose a folder with JPEG, PNG, TIFF, WebP or HEIC files.")
    return sorted(files, key=lambda path: _name(folder, path))


def file_listing(folder: Path, files: Iterable[Path]) -> list[list[Any]]:
    """Return name, size and time of change of each file, as JSON values that change when a photo changes.

    A file that cannot be examined, such as a link that leads nowhere, is listed by its name.
    """
    listing: list[list[Any]] = []
    for path in files:
        try:
            status = path.stat()
            listing.append([visible(str(path.relative_to(folder))), status.st_size, status.st_mtime_ns])
        except OSError:
            listing.append([visible(str(path.relative_to(folder))), None, None])
    return listing


def _pictures_among(parent: str, names: list[str]) -> list[Path]:
    """Return the pictures and videos among the files of a folder, without the moving parts of Live Photos."""
    kinds = {name: kind_of_file(Path(parent, name)) for name in names}
    stills = [name for name, kind in kinds.items() if kind in PICTURES]
    return [
        Path(parent, name)
        for name, kind in kinds.items()
        if (kind is not None or has_suffix_of_picture(name)) and live_photo_of(name, kind, stills) is None
    ]


def _name(folder: Path, path: Path) -> str:
    return path.relative_to(folder).as_posix()


def _rejected(folder: Path, path: Path, reason: str) -> RejectedPhoto:
    return RejectedPhoto(visible(_name(folder, path)), reason)


def _unsupported(folder: Path, path: Path) -> str | None:
    return problem_of_name(_name(folder, path)) or refusal_of(kind_of_file(path), path.suffix)


def _decode_all(
    folder: Path, paths: list[Path], settings: PhotoSettings, should_stop: StopCheck
) -> Iterator[_DecodedPhoto | RejectedPhoto]:
    """Yield the measurements or the rejection of each file, in order; files are decoded on all cores."""
    pool = ThreadPoolExecutor(max_workers=min(8, os.cpu_count() or 1))
    try:
        for result in pool.map(lambda path: _decode(folder, path, settings, should_stop), paths):
            yield result
            if should_stop():
                raise Cancelled("Reading the photos was stopped. Nothing was changed.")
    finally:
        pool.shutdown(cancel_futures=True)


def _decode(folder: Path, path: Path, settings: PhotoSettings, should_stop: StopCheck) -> _DecodedPhoto | RejectedPhoto:
    name = _name(folder, path)
    if path.is_dir():
        if os.access(path, os.R_OK | os.X_OK) and not path.is_symlink():
            return _rejected(folder, path, "It is a folder.")
        return _rejected(
            folder, path, "It is a folder that cannot be read, or a link to a folder, which is not followed."
        )
    try:
        header = read_header(path)
        if min(header.width, header.height) < settings.min_side:
            return RejectedPhoto(
                name,
                f"It has only {header.width} x {header.height} pixels; at least {settings.min_side} on each side are "
                "needed.",
            )
        measured = call_within_bounds(measure_photo, path, header, should_stop=should_stop)
    except PhotoError as error:
        return RejectedPhoto(name, _as_reason(error, path))
    return _DecodedPhoto(
        photo=Photo(name, measured["width"], measured["height"], measured["focal_px"], measured["sha256"]),
        compared=ComparedPhoto(
            name,
            Look.from_values(measured["look"]),
            measured["pixels_hash"],
            measured["focal_px"] is not None,
            measured["n_bytes"],
        ),
        sharpness=measured["sharpness"],
        flat_reason=_flat_reason(measured["not_black"], measured["not_white"], settings.flat_share),
        unusual_reason=measured["unusual"],
        circle=None if measured["circle"] is None else tuple(measured["circle"]),
    )


def measure_photo(path: str) -> dict[str, Any]:
    """Decode a photo and return its size, focal length, hashes, sharpness, `Look` and projection as JSON values."""
    image, focal = open_photo(Path(path))
    width, height = image.size if orientation_of(image) < 5 else image.size[::-1]
    step = max(1, round(max(width, height) / _MEASURING_SIDE))
    digest = hashlib.blake2b(digest_size=16, key=f"{width}x{height}".encode())
    look = LookBuilder(width, height, step)
    strips = []
    for strip in upright_strips(image, step):
        look.add(strip)
        digest.update(np.ascontiguousarray(strip).data)
        strips.append(_gray_for_measuring(strip, step))
    gray = np.concatenate(strips)
    return {
        "width": width,
        "height": height,
        "focal_px": focal,
        "sha256": file_sha256(Path(path)),
        "n_bytes": Path(path).stat().st_size,
        "pixels_hash": digest.hexdigest(),
        "look": look.values(gray, taken=capture_time(image), encoding=_encoding(image)),
        "sharpness": _sharpness(gray),
        "not_black": float(np.mean(gray > 8.0)),
        "not_white": float(np.mean(gray < 247.0)),
        "unusual": unusual_picture(image, path, gray),
        "circle": circle_of(gray),
    }


def _encoding(image: Image.Image) -> str:
    """Return a text that is equal for photos that one program saved with one setting."""
    tables = sorted((number, tuple(table)) for number, table in getattr(image, "quantization", {}).items())
    # A fourth byte that is not used depends on the decoder.
    mode = image.mode.removesuffix("X")
    return f"{image.format} {mode} {hash(tuple(tables))} {'exif' in image.info}"


def _as_reason(error: PhotoError, path: Path) -> str:
    """Return the error's message without the file's name, which is reported with the reason already."""
    message = str(error)
    for subject in (path.name, str(path)):
        if message.startswith(subject):
            return "It" + message[len(subject) :]
    return message


def _gray_for_measuring(pixels: NDArray[np.uint8], step: int) -> NDArray[np.float32]:
    """Return the brightness [h // step, w // step], 0 to 255, averaged over squares of `step` pixels."""
    height, width = (side // step * step for side in pixels.shape[:2])
    gray = pixels[:height, :width] @ GRAY_WEIGHTS
    averaged: NDArray[np.float32] = gray.reshape(height // step, step, width // step, step).mean(axis=(1, 3))
    return averaged


def _sharpness(gray: NDArray[np.float32]) -> float:
    """Return the 99th percentile of the absolute Laplacian over the contrast (1st to 99th percentile).

    The high percentile measures the sharpest percent of the pixels, so a photo of a sharp object in front of a plain or
    soft background is sharp.
    """
    laplacian = gray[:-2, 1:-1] + gray[2:, 1:-1] + gray[1:-1, :-2] + gray[1:-1, 2:] - np.float32(4.0) * gray[1:-1, 1:-1]
    dark, bright = np.percentile(gray, (1, 99))
    return float(np.percentile(np.abs(laplacian), 99) / max(bright - dark, 1.0))


def _flat_reason(not_black: float, not_white: float, share: float) -> str | None:
    if not_black < share:
        return "It is black; was the lens cap on?"
    if not_white < share:
        return "It is white: overexposed throughout."
    return None


_Selection = tuple[list[_DecodedPhoto], list[RejectedPhoto]]


def _split(decoded: list[_DecodedPhoto], reason: Callable[[_DecodedPhoto], str | None]) -> _Selection:
    """Split `decoded` into the photos for which `reason` returns None, and the rejected ones."""
    kept: list[_DecodedPhoto] = []
    rejected: list[RejectedPhoto] = []
    for entry in decoded:
        text = reason(entry)
        if text is None:
            kept.append(entry)
        else:
            rejected.append(RejectedPhoto(entry.photo.name, text))
    return kept, rejected


def _without_masks(decoded: list[_DecodedPhoto], summaries: list[str | None]) -> _Selection:
    masks = masks_among({entry.photo.name: entry.compared.look for entry in decoded})
    summaries.append(summary_of_masks(masks))
    return _split(decoded, lambda entry: masks.get(entry.photo.name))


def _without_copies(decoded: list[_DecodedPhoto], summaries: list[str | None]) -> _Selection:
    copies = copies_among([entry.compared for entry in decoded])
    summaries.append(summary_of_copies(copies, len(decoded)))
    return _split(decoded, lambda entry: copies.get(entry.photo.name))


def _without_flat(decoded: list[_DecodedPhoto]) -> _Selection:
    return _split(decoded, lambda entry: entry.flat_reason)


def _without_unusual(decoded: list[_DecodedPhoto]) -> _Selection:
    return _split(decoded, lambda entry: entry.unusual_reason)


def _without_fisheye(decoded: list[_DecodedPhoto]) -> _Selection:
    photos = [entry.photo for entry in decoded]
    focals = [None if one.focal_px is None else one.focal_px / min(one.width, one.height) for one in photos]
    round_ones = fisheye_photos([entry.circle for entry in decoded], focals)
    names = {photo.name for photo, is_round in zip(photos, round_ones, strict=True) if is_round}
    return _split(decoded, lambda entry: FISHEYE_PICTURE if entry.photo.name in names else None)


def _without_blurred(decoded: list[_DecodedPhoto], settings: PhotoSettings) -> _Selection:
    """Reject the few photos that are much less sharp than the median photo."""
    if len(decoded) < settings.min_photos_for_blur or settings.blur_ratio == 0.0:
        return decoded, []
    median = float(np.median([entry.sharpness for entry in decoded]))
    soft = [entry for entry in decoded if entry.sharpness < settings.blur_ratio * median]
    max_rejected = max(1, int(settings.max_blurred_share * len(decoded)))
    if len(soft) > max_rejected:
        _LOG.info("%d photos are soft; only the %d softest are rejected", len(soft), max_rejected)
    blurred = {entry.photo.name for entry in sorted(soft, key=lambda entry: entry.sharpness)[:max_rejected]}

    def reason(entry: _DecodedPhoto) -> str | None:
        if entry.photo.name not in blurred:
            return None
        percent = round(100.0 * entry.sharpness / median)
        return f"It is blurred: {percent} % as sharp as the median photo."

    return _split(decoded, reason)
