"""Masks of the object before its background, made by Segment Anything for photos with a background that stands still.

Such masks keep features and training away from the background, see `photos.photo_masks`. What moves between photos of
a camera on a tripod is the object on its turntable, and shows Segment Anything where to look. Where the camera moves,
the object is taken to stand in the middle.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..core.arrays import Mask, evenly_spaced_indices
from ..core.errors import Cancelled, MaskError
from ..core.events import Emit, Progress, StopCheck, Warned
from ..core.files import write_file
from ..photos import load_pixels
from ..scene import Photo, PhotoSet
from .sam import INPUT_SIDE, Embedding, SegmentAnything

_LOOK_SIDE = 256
"""Longest side in pixels at which photos are compared for what moves."""
_MAX_LOOKS = 24
"""Photos that are compared, evenly spaced."""
_STILL_DEVIATION = 14.0
"""Largest deviation of the brightness of a pixel from its median over the photos, of 255, where nothing moves."""
_MIN_STILL_SHARE = 0.25
"""Least share of still pixels of photos from one place; the object and its shadow move in the others."""
_MIN_MOVING_SHARE = 0.005
_MIDDLE = 0.15
"""Margin around the object in photos from many places, as a share of the sides."""
_MIN_INSIDE = 0.8
"""Least share of a mask that lies where something moves."""
_FRAME_SHARES = (0.005, 0.9)
"""Smallest and largest share of the frame that an object covers."""
_WIDENED = 0.006
"""Width by which a mask is widened, as a share of the longest side: features lie on the object's edge too."""


def make_foreground_masks(
    photo_set: PhotoSet,
    folder: Path,
    load: Callable[[], SegmentAnything],
    *,
    emit: Emit,
    should_stop: StopCheck,
) -> None:
    """Write a mask of the object for each photo to `folder`, as ``photo.jpg.png``, white on the object.

    Parameters
    ----------
    load : callable
        Returns the SAM.
    emit : Emit
        Receives a `Progress` per photo, and a `Warned` that names the photos in which no object was found.
    should_stop : StopCheck
        Called before each photo.

    Raises
    ------
    MaskError
        When no object was found in any photo.
    ModelFileError
        When the SAM is missing.
    PhotoError
        When a photo can no longer be read.
    Cancelled
        When `should_stop` returns True.

    Notes
    -----
    About 1.5 CPU seconds per photo.
    """
    region = _moving_region(photo_set)
    sam = load()
    without = []
    for n_done, photo in enumerate(photo_set.photos):
        if should_stop():
            raise Cancelled(f"Stopped after {n_done} of {len(photo_set.photos)} masks. The next run starts them again.")
        emit(Progress("photos", n_done / len(photo_set.photos), message=f"object in {photo.name}"))
        pixels = load_pixels(photo_set.folder / photo.name, max_side=INPUT_SIDE)
        mask = _object_mask(sam, sam.encode(pixels), region)
        if mask is None:
            without.append(photo.name)
        else:
            _write(folder / f"{photo.name}.png", mask, photo)
    if len(without) == len(photo_set.photos):
        raise MaskError(
            f"Segment Anything found no object before the background of the photos in {photo_set.folder}. Make masks "
            "by hand and give their folder with --photo-masks (in Blender: Masks)."
        )
    if without:
        emit(
            Warned(
                f"No object was found in {len(without)} of {len(photo_set.photos)} photos, which are used whole: "
                f"{', '.join(without)}."
            )
        )


def _moving_region(photo_set: PhotoSet) -> Mask | None:
    """Return what moves between photos from one place, at their size reduced to 256 pixels; None for many places."""
    photos = photo_set.photos
    size = (photos[0].width, photos[0].height)
    same = [photo for photo in photos if (photo.width, photo.height) == size]
    chosen = [same[index] for index in evenly_spaced_indices(len(same), _MAX_LOOKS)]
    if len(chosen) < 3 or len(same) < len(photos) / 2:
        return None
    with ThreadPoolExecutor(max_workers=min(8, os.cpu_count() or 1)) as pool:
        looks = np.stack(list(pool.map(lambda photo: _look(photo_set.folder, photo), chosen)))
    deviation = np.quantile(np.abs(looks - np.median(looks, axis=0)), 0.9, axis=0)
    moving = (deviation > _STILL_DEVIATION).astype(np.uint8)
    if 1.0 - moving.mean() < _MIN_STILL_SHARE:
        return None
    # Noise, and leaves in the background, are small; an object of one colour moves only at its edge.
    moving = cv2.morphologyEx(moving, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    moving = cv2.morphologyEx(moving, cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8))
    _, parts, statistics, _ = cv2.connectedComponentsWithStats(moving, connectivity=8)
    areas = statistics[1:, cv2.CC_STAT_AREA]
    if not len(areas) or areas.max() < _MIN_MOVING_SHARE * moving.size:
        return None
    return _filled(parts == 1 + int(areas.argmax()))


def _look(folder: Path, photo: Photo) -> NDArray[np.float32]:
    pixels = load_pixels(folder / photo.name, max_side=_LOOK_SIDE)
    return np.asarray(cv2.GaussianBlur(pixels.mean(axis=2).astype(np.float32), (0, 0), 1.0), np.float32)


def _object_mask(sam: SegmentAnything, embedding: Embedding, region: Mask | None) -> Mask | None:
    """Return the mask of the object in the frame of the encoded photo; None where none is found."""
    size = embedding.height, embedding.width
    if region is None:
        left, top = _MIDDLE * size[1], _MIDDLE * size[0]
        box = [left, top, size[1] - left, size[0] - top]
        click, allowed = (size[1] / 2.0, size[0] / 2.0), np.ones(size, bool)
    else:
        where = cv2.resize(region.astype(np.uint8), size[::-1], interpolation=cv2.INTER_NEAREST)
        x, y, wide, high = cv2.boundingRect(where)
        box = [float(x), float(y), float(x + wide), float(y + high)]
        _, _, _, deepest = cv2.minMaxLoc(cv2.distanceTransform(where, cv2.DIST_L2, 5))
        click = deepest[0] + 0.5, deepest[1] + 0.5
        side = 2 * round(0.02 * max(size)) + 1
        allowed = cv2.dilate(where, np.ones((side, side), np.uint8)) > 0
    best: tuple[float, Mask] | None = None
    for points, labels, prompt_box in ([click], [1], box), (None, None, box), ([click], [1], None):
        found = sam.predict(embedding, points, labels, prompt_box)
        mask = found.mask
        share = float(mask.mean())
        is_usual = _FRAME_SHARES[0] <= share <= _FRAME_SHARES[1] and (mask & allowed).sum() >= _MIN_INSIDE * mask.sum()
        score = found.iou
        if region is not None:
            # Of an object and a part of it, the object: it fills more of what moves.
            score *= float((mask & allowed).sum()) / float(allowed.sum())
        if is_usual and (best is None or score > best[0]):
            best = score, mask
    return None if best is None else _filled(_largest(best[1]))


def _largest(mask: Mask) -> Mask:
    _, parts, statistics, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    return np.asarray(parts == 1 + int(statistics[1:, cv2.CC_STAT_AREA].argmax()))


def _filled(mask: Mask) -> Mask:
    """Return the mask without holes."""
    outlines: Sequence[NDArray[np.int32]]
    outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    filled = np.zeros(mask.shape, np.uint8)
    cv2.drawContours(filled, outlines, -1, 1, cv2.FILLED)
    return filled > 0


def _write(path: Path, mask: Mask, photo: Photo) -> None:
    side = 2 * max(1, round(_WIDENED * max(mask.shape))) + 1
    widened = cv2.dilate(mask.astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)))
    whole = cv2.resize(widened, (photo.width, photo.height), interpolation=cv2.INTER_NEAREST)
    encoded = io.BytesIO()
    Image.fromarray(whole > 0).save(encoded, "PNG")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_file(path, encoded.getvalue())
