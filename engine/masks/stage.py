"""The masks stage: a label map for each photo that is wanted, kept from run to run while its photo stays the same.

SAM's embeddings of these photos stay beside them, for clicks and texts later (`engine.masks.embeddings`).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

from ..errors import Cancelled, MaskError
from ..events import Emit, Progress, StopCheck
from ..photos import load_pixels
from ..project_folder import stage_key
from ..scene import CameraSet, Photo, PhotoSet
from ..settings import to_dict
from .automatic import segment_everything
from .embeddings import EmbeddingFolder
from .sam import INPUT_SIDE, SegmentAnything
from .settings import MaskSettings
from .storage import label_map_path, read_recipe, write_label_map

__all__ = ["make_masks"]

# Raised when the way masks are made changes, so that label maps of an older engine are made anew.
_METHOD_VERSION = 1


def make_masks(
    photo_set: PhotoSet,
    camera_set: CameraSet,
    names: Sequence[str],
    folder: Path,
    settings: MaskSettings,
    sam: SegmentAnything,
    *,
    emit: Emit,
    should_stop: StopCheck,
) -> dict[str, Path]:
    """Return the label map files of the photos `names`, making those that are missing or out of date.

    Parameters
    ----------
    photo_set : PhotoSet
    camera_set : CameraSet
        Registered photos: a label map of a photo without a camera would be of no use.
    names : sequence of str
        Photo names.
    folder : Path
        The project's ``masks`` folder.
    settings : MaskSettings
    sam : SegmentAnything
    emit : Emit
        Gets a `Progress` of stage ``masks`` a photo.
    should_stop : StopCheck
        Asked before each photo and each click.

    Raises
    ------
    MaskError
        When a name is not that of a registered photo.
    PhotoError
        When a photo can no longer be read.
    Cancelled
        When `should_stop` says so; label maps written before stay.

    Notes
    -----
    About 3 seconds a photo on two idle cores.
    """
    photos = {photo.name: photo for photo in photo_set.photos}
    registered = {camera.photo for camera in camera_set.cameras}
    for name in names:
        if name not in photos or name not in registered:
            raise MaskError(f"{name} is not a registered photo of {photo_set.folder}; masks are made for those only.")
    paths = {name: label_map_path(folder, name) for name in names}
    stale = [name for name in names if read_recipe(paths[name]) != _recipe(photos[name], settings)]
    embeddings = EmbeddingFolder(folder)
    start = time.perf_counter()
    for done, name in enumerate(stale):
        if should_stop():
            raise Cancelled(f"Stopped after {done} of {len(stale)} label maps; the next run continues there.")
        left = (time.perf_counter() - start) / done * (len(stale) - done) if done else None
        emit(Progress("masks", done / len(stale), left, message=f"Segments of {name}"))
        # No more pixels than the encoder or the label map can hold.
        pixels = load_pixels(photo_set.folder / name, max_side=max(settings.max_side, INPUT_SIDE))
        labels = segment_everything(embeddings.encode(name, pixels, sam), sam, settings, should_stop=should_stop)
        write_label_map(paths[name], labels, recipe=_recipe(photos[name], settings))
    emit(Progress("masks", 1.0, 0.0, message=f"{len(names)} label maps, {len(names) - len(stale)} of them kept"))
    return paths


def _recipe(photo: Photo, settings: MaskSettings) -> str:
    return stage_key(_METHOD_VERSION, photo.sha256, to_dict(settings))
