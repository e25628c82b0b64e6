"""Copies of the photos for COLMAP: upright (EXIF rotation applied), scaled down, with ASCII names, grouped by lens."""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Hashable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from ..core.errors import Cancelled, FormatError
from ..core.events import StopCheck
from ..core.files import opened, write_file
from ..photos import load_with_valid
from ..scene import Photo, PhotoSet

_END_OF_JPEG, _END_OF_PNG = b"\xff\xd9", b"IEND\xaeB`\x82"


@dataclass(frozen=True)
class WorkingCopy:
    """A scaled copy of a photo.

    Attributes
    ----------
    photo : Photo
        The original photo.
    name : str
        ``GROUP/INDEX.jpg``, relative to the folder of copies. The photos of a group share a lens.
    width, height : int
        Size of the copy in pixels.
    """

    photo: Photo
    name: str
    width: int
    height: int

    @property
    def focal_px(self) -> float | None:
        """Focal length from EXIF in pixels of the copy, None when unknown."""
        return None if self.photo.focal_px is None else self.photo.focal_px * self.width / self.photo.width


def plan_copies(photo_set: PhotoSet, max_side: int, lens_of: Callable[[Photo], Hashable]) -> list[WorkingCopy]:
    """Return the copies in the order of the photos; photos for which `lens_of` is equal share a group."""
    groups: dict[Hashable, int] = {}
    copies = []
    for index, photo in enumerate(photo_set.photos):
        group = groups.setdefault(lens_of(photo), len(groups))
        width, height = _matching_size(photo.width, photo.height, max_side)
        copies.append(WorkingCopy(photo, f"{group:05d}/{index:06d}.jpg", width, height))
    return copies


def _matching_size(width: int, height: int, max_side: int) -> tuple[int, int]:
    """Return a size of at most `max_side` whose horizontal and vertical scales agree best.

    Rounding the shorter side changes its scale by up to half a pixel, which a lens with one focal length cannot
    represent. Of the sizes within 10 % below `max_side`, the one with the smallest rounding error is taken: for a
    `max_side` of 1,000, 728 x 1092 becomes exactly 666 x 999.
    """
    longest, shortest = max(width, height), min(width, height)
    if longest <= max_side:
        return width, height

    def rounding_error(side: int) -> tuple[float, int]:
        exact = shortest * side / longest
        return round(abs(exact - round(exact)) / exact, 6), -side

    side = min(range(max(1, max_side * 9 // 10), max_side + 1), key=rounding_error)
    shorter = max(1, round(shortest * side / longest))
    return (side, shorter) if width >= height else (shorter, side)


def write_copies(
    copies: list[WorkingCopy],
    source: Path,
    folder: Path,
    masks: Path,
    *,
    report: Callable[[float], None],
    should_stop: StopCheck,
) -> None:
    """Write missing and cut copies to `folder`, and masks of their photos to `masks` under the names COLMAP expects.

    Raises
    ------
    PhotoError
        When a photo has changed and cannot be read.
    DiskError
        When a copy cannot be written.
    Cancelled
        When `should_stop` returned True.
    """
    missing = [copy for copy in copies if not _is_whole(copy, folder, masks)]
    pool = ThreadPoolExecutor(max_workers=min(8, os.cpu_count() or 1))
    try:
        for index, _ in enumerate(pool.map(lambda copy: _write_copy(copy, source, folder, masks), missing)):
            report((index + 1) / len(missing))
            if should_stop():
                raise Cancelled("Stopped while copying the photos. The next run continues from here.")
    finally:
        pool.shutdown(cancel_futures=True)


def write_default_masks(copies: list[WorkingCopy], masks: Path) -> None:
    """Write a mask that excludes no pixel for each copy without a mask in `masks`.

    Raises
    ------
    DiskError
        When a mask cannot be written.
    """
    for copy in copies:
        if not _ends_with(file := _mask_of(copy, masks), _END_OF_PNG):
            _write(file, Image.new("1", (copy.width, copy.height), 1), "PNG")


def _mask_of(copy: WorkingCopy, masks: Path) -> Path:
    return masks / f"{copy.name}.png"


def _is_whole(copy: WorkingCopy, folder: Path, masks: Path) -> bool:
    """Return whether a copy exists and neither it nor its mask, if it has one, was cut."""
    mask = _mask_of(copy, masks)
    return _ends_with(folder / copy.name, _END_OF_JPEG) and (not mask.exists() or _ends_with(mask, _END_OF_PNG))


def _ends_with(file: Path, ending: bytes) -> bool:
    try:
        with opened(file, advice="It is written again.") as stream:
            stream.seek(-len(ending), os.SEEK_END)
            return stream.read() == ending
    except FormatError:
        return False


def _write_copy(copy: WorkingCopy, source: Path, folder: Path, masks: Path) -> None:
    mask = None if copy.photo.mask is None else Path(copy.photo.mask)
    pixels, valid = load_with_valid(source / copy.photo.name, mask, max_side=max(copy.width, copy.height))
    if valid is not None:
        # Before the copy, so that an existing copy always has its mask.
        mask_picture = Image.fromarray(valid).resize((copy.width, copy.height), Image.Resampling.NEAREST)
        _write(_mask_of(copy, masks), mask_picture, "PNG")
    picture = Image.fromarray(pixels)
    if picture.size != (copy.width, copy.height):
        # A side half-way between two integers may have been rounded differently.
        picture = picture.resize((copy.width, copy.height), Image.Resampling.BICUBIC)
    _write(folder / copy.name, picture, "JPEG", quality=97, subsampling=0)


def _write(path: Path, picture: Image.Image, kind: str, **options: int) -> None:
    encoded = io.BytesIO()
    picture.save(encoded, kind, **options)
    write_file(path, encoded.getvalue())
