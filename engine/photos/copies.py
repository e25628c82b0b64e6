"""Find photos that show the same shot in other pixels: reductions, re-encodings, messenger copies, rotated copies.

A copy and its original show everything at the same place. Two shots do not, however close they are: the camera or the
scene moved by a fraction of a pixel, or the file says another time. So places are compared, not colours, which
messengers change. See docs/photos.md for what is found and what is not, and docs/design_notes/photos.md for the
measurements behind the thresholds.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float32
from .look import Look, area_reduced
from .names import compared_stem

_THUMB = 16
"""Side of the thumbnails by which pairs are preselected, in pixels."""
_MIN_THUMB_CORRELATION = 0.95
"""Least correlation of the thumbnails of a pair that is compared. Copies have more than 0.98."""
_MIN_THUMB_DEVIATION = 3.0
"""Least standard deviation of a thumbnail; a flatter one looks like any other flat one."""
_ROWS_AT_ONCE = 512
_SIDE_TOLERANCE = 2.0
"""Pixels by which a side of a reduced copy may differ from the exact one: some programs round to even numbers."""
_BLOCK = 16
"""Side of the compared blocks of a reduced picture, in pixels; blocks of crops are larger by the factor 2.5."""
_BLUR = 1.0
"""Standard deviation of the blur before the comparison, which removes what programs reduce differently."""
_MIN_DEVIATION = 4.0
"""Least standard deviation of a block that has something to compare, of 255."""
_MIN_CORNER = 4.0
"""Least mean squared gradient along the weaker direction of a block whose displacement can be measured."""
_MIN_BLOCKS = 8
"""Least number of blocks by which photos are compared."""
_MAX_DISPLACEMENT = 0.25
"""Largest displacement of a block in pixels between photos of equal size. Re-encodings have up to 0.14; a small thing
that moved by a two-hundredth of the picture has 0.5."""
_MAX_MEDIAN_DISPLACEMENT = 0.06
"""Largest median of the displacements between photos of equal size. Re-encodings have up to 0.03, and a camera that
moved by a quarter of a pixel has 0.3 in the crops."""
_MIN_CORRELATION = 0.85
"""Least correlation of a block between photos of equal size. Re-encodings that change colours have at least 0.93."""
_MAX_REDUCED_DISPLACEMENT = 0.75
"""The same between photos of unequal size: programs that skip pixels shift by up to half a pixel of the copy."""
_MAX_REDUCED_SPREAD = 0.3
"""Largest median of the displacements around their own median, between photos of unequal size."""


@dataclass(frozen=True)
class ComparedPhoto:
    """A photo and how good it is among its copies.

    Attributes
    ----------
    name : str
    look : Look
    pixels_hash : str
        Equal for equal pixels.
    has_focal : bool
        Whether EXIF states the focal length; copies often lose it.
    n_bytes : int
        Size of the file.
    """

    name: str
    look: Look
    pixels_hash: str
    has_focal: bool
    n_bytes: int


def copies_among(photos: Sequence[ComparedPhoto]) -> dict[str, str]:
    """Return why photos that are copies of others are left out, as a sentence by name.

    Of the copies of a shot the largest is kept; of equally large ones that with a focal length, the largest file, and
    the first name, in this order.

    Parameters
    ----------
    photos : sequence of ComparedPhoto
        With different names.
    """
    ordered = sorted(
        range(len(photos)),
        key=lambda i: (
            -photos[i].look.width * photos[i].look.height, not photos[i].has_focal, -photos[i].n_bytes, photos[i].name
        ),
    )  # fmt: skip
    partners = _candidates([photos[i] for i in ordered])
    reasons: dict[str, str] = {}
    for rank, i in enumerate(ordered):
        photo = photos[i]
        found: list[tuple[bool, float, str]] = []
        for other_rank, turns in partners.get(rank, ()):
            original = photos[ordered[other_rank]]
            if other_rank >= rank or original.name in reasons:
                continue
            is_equal = photo.pixels_hash == original.pixels_hash
            likeness = 1.0 if is_equal else _likeness(original, photo, turns)
            if likeness > 0.0:
                found.append(
                    (_same_name(original.name, photo.name), likeness, _reason(original, photo, turns, is_equal))
                )
        if found:
            reasons[photo.name] = max(found, key=lambda entry: entry[:2])[2]
    return reasons


def summary_of_copies(reasons: dict[str, str], n_files: int) -> str | None:
    """Return one sentence about the copies of a folder; None without copies.

    Parameters
    ----------
    reasons : dict of str to str
        Result of `copies_among`.
    n_files : int
        Number of photos that were compared.
    """
    if not reasons:
        return None
    folders = Counter(PurePosixPath(name).parent.as_posix() for name in reasons)
    places = ", ".join(
        f"{count} in {'the folder itself' if folder == '.' else folder}" for folder, count in sorted(folders.items())
    )
    return (
        f"{len(reasons)} of {n_files} photos show the same shot as another one ({places}). Each shot is used once, in "
        "its largest version."
    )


def _reason(original: ComparedPhoto, photo: ComparedPhoto, turns: int, is_equal: bool) -> str:
    if is_equal and not turns:
        return f"It is the same picture as {original.name}."
    first, second = original.look, photo.look
    kind = "smaller " if first.width * first.height > second.width * second.height else ""
    turned = ", rotated" if turns else ""
    return f"It shows the same shot as {original.name}: it is a {kind}copy{turned}."


def _candidates(photos: Sequence[ComparedPhoto]) -> dict[int, list[tuple[int, int]]]:
    """Return by photo the earlier photos that look alike, with the quarter turns that make it upright like them."""
    thumbs = np.zeros((len(photos), _THUMB, _THUMB), np.float32)
    for thumb, photo in zip(thumbs, photos, strict=True):
        gray = area_reduced(photo.look.small.astype(np.float32), (_THUMB, _THUMB))
        if gray.std() >= _MIN_THUMB_DEVIATION:
            thumb[:] = (gray - gray.mean()) / (gray.std() * _THUMB)
    found: dict[int, list[tuple[int, int]]] = {}
    flat = thumbs.reshape(len(photos), _THUMB * _THUMB)
    for turns in range(4):
        turned = np.ascontiguousarray(np.rot90(thumbs, turns, axes=(1, 2))).reshape(flat.shape)
        for top in range(0, len(photos), _ROWS_AT_ONCE):
            # Not a product of matrices, for which the linear algebra library would keep large buffers.
            alike = np.einsum("ik,jk->ij", turned[top : top + _ROWS_AT_ONCE], flat) > _MIN_THUMB_CORRELATION
            for row, column in zip(*np.nonzero(alike), strict=True):
                if column < top + row:
                    found.setdefault(int(top + row), []).append((int(column), turns))
    # Pictures without contrast are only compared by their hash.
    first: dict[str, int] = {}
    for i, photo in enumerate(photos):
        original = first.setdefault(photo.pixels_hash, i)
        if original != i and (original, 0) not in found.get(i, []):
            found.setdefault(i, []).append((original, 0))
    return found


def _likeness(original: ComparedPhoto, photo: ComparedPhoto, turns: int) -> float:
    """Return how alike a shot and its copy, which has at most as many pixels, are: 0 to 1, 0 for another shot."""
    first, second = original.look, photo.look
    if _are_of_different_times(first.taken, second.taken):
        return 0.0
    width, height = (second.height, second.width) if turns % 2 else (second.width, second.height)
    if not _is_reduction((width, height), (first.width, first.height)):
        return 0.0
    small = np.rot90(second.small, turns).astype(np.float32)
    reduced = area_reduced(first.small.astype(np.float32), (small.shape[1], small.shape[0]))
    blocks = _compare(reduced, small, _BLOCK)
    same_name = _same_name(original.name, photo.name)
    if same_name and blocks.is_partly_equal():
        return blocks.likeness
    if (width, height) != (first.width, first.height):
        return blocks.likeness if blocks.is_reduction() else 0.0
    if not blocks.is_unmoved():
        return 0.0
    crops = _compare(first.detail.astype(np.float32), np.rot90(second.detail, turns).astype(np.float32), 40)
    if not crops.is_unmoved(min_blocks=0):
        return 0.0
    if first.encoding == second.encoding and not turns and not _is_named_after(original.name, photo.name):
        # One camera or program wrote both: two shots of a burst on a tripod.
        return 0.0
    return blocks.likeness


def _are_of_different_times(first: str | None, second: str | None) -> bool:
    if not first or not second:
        return False
    (time, _, fraction), (other_time, _, other_fraction) = first.partition("."), second.partition(".")
    # Programs that copy EXIF may lose the fraction.
    return time != other_time or bool(fraction and other_fraction and fraction != other_fraction)


def _is_reduction(size: tuple[int, int], original: tuple[int, int]) -> bool:
    """Return whether a picture of `size` can be one of the size `original`, reduced as a whole, with rounded sides."""
    scale = max(size[0] / original[0], size[1] / original[1])
    return scale <= 1.0 and all(
        abs(original[axis] * scale - size[axis]) <= _SIDE_TOLERANCE and size[axis] <= original[axis] for axis in (0, 1)
    )


def _same_name(name: str, other: str) -> bool:
    """Return whether two files of different folders have the same name, whatever their formats."""
    first, second = PurePosixPath(name), PurePosixPath(other)
    return first.parent != second.parent and compared_stem(first.name) == compared_stem(second.name)


def _is_named_after(name: str, other: str) -> bool:
    """Return whether one name begins with the other, as ``photo (1).jpg`` and ``photo-edited.jpg`` do."""
    first, second = compared_stem(PurePosixPath(name).name), compared_stem(PurePosixPath(other).name)
    short, long = sorted((first, second), key=len)
    return long.startswith(short) and not re.match(r"\d", long[len(short) :])


@dataclass(frozen=True)
class _Blocks:
    """Comparison of the blocks of two pictures.

    Attributes
    ----------
    correlation : array of shape [B], float64
        Of the blocks with something to compare.
    displacement : array of shape [C, 2], float64
        In pixels, of the blocks with gradients in two directions.
    """

    correlation: NDArray[np.float64]
    displacement: NDArray[np.float64]

    @property
    def likeness(self) -> float:
        """Median correlation, for choosing among several originals."""
        return max(float(np.median(self.correlation)), 1e-6) if len(self.correlation) else 1e-6

    def is_unmoved(self, *, min_blocks: int = _MIN_BLOCKS) -> bool:
        """Return whether pictures of equal size show everything at the same place."""
        if len(self.correlation) < min_blocks:
            return False
        if self.correlation.min(initial=1.0) < _MIN_CORRELATION:
            return False
        lengths = np.linalg.norm(self.displacement, axis=1)
        if not len(lengths):
            return True
        return bool(lengths.max() <= _MAX_DISPLACEMENT and np.median(lengths) <= _MAX_MEDIAN_DISPLACEMENT)

    def is_reduction(self) -> bool:
        """Return whether the second picture is a reduced copy of the first."""
        if len(self.correlation) < _MIN_BLOCKS:
            return False
        if np.quantile(self.correlation, 0.05) < 0.6 or np.median(self.correlation) < 0.9:
            return False
        if not len(self.displacement):
            return True
        shift = np.median(self.displacement, axis=0)
        spread = np.median(np.linalg.norm(self.displacement - shift, axis=1))
        return bool(np.linalg.norm(shift) <= _MAX_REDUCED_DISPLACEMENT and spread <= _MAX_REDUCED_SPREAD)

    def is_partly_equal(self) -> bool:
        """Return whether a good part of both pictures is the same, as where one has its background removed."""
        if len(self.correlation) < _MIN_BLOCKS:
            return False
        lengths = np.linalg.norm(self.displacement, axis=1)
        return bool(
            np.mean(self.correlation > 0.95) >= 0.25
            and (not len(lengths) or np.median(lengths) <= _MAX_REDUCED_DISPLACEMENT)
        )


def _compare(first: Float32, second: Float32, side: int) -> _Blocks:
    """Compare two pictures of equal size in blocks of about `side` pixels.

    The brightness of each block is adapted first, so that changes of tone and colour do not count.
    """
    # Only here: OpenCV takes 100 MB of address space, and most folders have no two photos to compare.
    import cv2

    first, second = (np.asarray(cv2.GaussianBlur(one, (0, 0), _BLUR), np.float32) for one in (first, second))
    slopes = np.gradient(first, axis=1), np.gradient(first, axis=0)
    height, width = first.shape
    rows, columns = max(1, height // side), max(1, width // side)
    correlations, displacements = [], []
    for j in range(rows):
        for i in range(columns):
            block = np.s_[
                j * height // rows : (j + 1) * height // rows, i * width // columns : (i + 1) * width // columns
            ]
            a, b = (np.asarray(picture[block], np.float64) for picture in (first, second))
            a, b = a - a.mean(), b - b.mean()
            deviations = float(a.std()), float(b.std())
            if max(deviations) < _MIN_DEVIATION:
                continue
            product = float(np.mean(a * b))
            correlations.append(product / max(deviations[0] * deviations[1], 1e-9))
            gradients = np.stack([slope[block].ravel() for slope in slopes]).astype(np.float64)
            tensor = gradients @ gradients.T / a.size
            if np.linalg.eigvalsh(tensor)[0] >= _MIN_CORNER:
                difference = a - b * (product / max(deviations[1] ** 2, 1e-9))
                displacements.append(np.linalg.solve(tensor, gradients @ difference.ravel() / a.size))
    return _Blocks(np.array(correlations), np.array(displacements).reshape(-1, 2))
