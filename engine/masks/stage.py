"""The masks stage: one label map per selected photo, reused in later runs while photo and settings are unchanged.

The next photo is encoded while the clicks of a photo are decoded: the two take about the same time on one core each.

SAM's embeddings of these photos are stored with the label maps, for later clicks and texts
(`engine.masks.embeddings`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from ..core.errors import Cancelled, MaskError
from ..core.events import Emit, Progress, StopCheck
from ..core.parts import part
from ..core.settings import to_dict
from ..photos import load_pixels
from ..project.folder import stage_key
from ..scene import Photo, PhotoSet
from .automatic import segment_everything
from .embeddings import EmbeddingFolder
from .sam import INPUT_SIDE, Embedding, SegmentAnything
from .settings import MaskSettings
from .storage import label_map_path, read_recipe, write_label_map

# Increased when the method changes, so that label maps of an older engine are computed again.
_METHOD_VERSION = 2


def make_masks(
    photo_set: PhotoSet,
    names: Sequence[str],
    folder: Path,
    settings: MaskSettings,
    load: Callable[[], SegmentAnything],
    *,
    emit: Emit,
    should_stop: StopCheck,
) -> dict[str, Path]:
    """Return the label map files of the photos `names`, computing those that are missing or out of date.

    Parameters
    ----------
    names : sequence of str
        Photo names.
    folder : Path
        The project's ``masks`` folder.
    load : callable
        Returns the SAM; called if a label map is missing or out of date.
    emit : Emit
        Receives what encodes the photos, and a `Progress` of stage ``masks`` per photo.
    should_stop : StopCheck
        Called before each photo and each click.

    Raises
    ------
    MaskError
        When one of `names` is not in `photo_set`.
    PhotoError
        When a photo can no longer be read.
    Cancelled
        When `should_stop` returns True; label maps written before are kept.

    Notes
    -----
    About 2.5 CPU seconds per photo, 1.8 in bfloat16, half of them on each of two cores.
    """
    photos = {photo.name: photo for photo in photo_set.photos}
    stale = stale_photos(photo_set, names, folder, settings)
    if stale:
        _make(stale, photos, photo_set.folder, folder, settings, load(), emit, should_stop)
    emit(Progress("masks", 1.0, 0.0, message=f"{len(names)} label maps, {len(names) - len(stale)} of them kept"))
    return {name: label_map_path(folder, name) for name in names}


def stale_photos(photo_set: PhotoSet, names: Sequence[str], folder: Path, settings: MaskSettings) -> list[str]:
    """Return the photos whose label map is missing or out of date; see `make_masks`, which raises the same."""
    photos = {photo.name: photo for photo in photo_set.photos}
    for name in names:
        if name not in photos:
            raise MaskError(f"{name} is not a photo of {photo_set.folder}, so it cannot have masks.")
    return [name for name in names if read_recipe(label_map_path(folder, name)) != _recipe(photos[name], settings)]


def _make(
    names: Sequence[str],
    photos: Mapping[str, Photo],
    photo_folder: Path,
    folder: Path,
    settings: MaskSettings,
    sam: SegmentAnything,
    emit: Emit,
    should_stop: StopCheck,
) -> None:
    """Write the label maps of `names`."""
    emit(Progress("masks", 0.0, message=sam.device))
    start = time.perf_counter()
    # More pixels than the encoder and the label map use would only cost memory.
    max_side = max(settings.max_side, INPUT_SIDE)
    with ThreadPoolExecutor(max_workers=1) as pool:
        embeddings = _encode_ahead(names, photo_folder, EmbeddingFolder(folder), sam, max_side, pool)
        for n_done, name in enumerate(names):
            if should_stop():
                raise Cancelled(f"Stopped after {n_done} of {len(names)} label maps; the next run continues there.")
            seconds_left = (time.perf_counter() - start) / n_done * (len(names) - n_done) if n_done else None
            emit(Progress("masks", n_done / len(names), seconds_left, message=f"Segments of {name}"))
            with part("waiting for the encoder"):
                embedding = next(embeddings)
            with part("segmenting"):
                labels = segment_everything(embedding, sam, settings, should_stop=should_stop)
            with part("writing"):
                write_label_map(label_map_path(folder, name), labels, recipe=_recipe(photos[name], settings))


def _encode_ahead(
    names: Sequence[str],
    photo_folder: Path,
    stored: EmbeddingFolder,
    sam: SegmentAnything,
    max_side: int,
    pool: ThreadPoolExecutor,
) -> Iterator[Embedding]:
    """Return the embeddings of photos one by one, each time after starting the next one in `pool`."""

    def encode(name: str) -> Embedding:
        return stored.encode(name, load_pixels(photo_folder / name, max_side=max_side), sam)

    started = pool.submit(encode, names[0])
    for name in [*names[1:], None]:
        embedding = started.result()
        if name is not None:
            started = pool.submit(encode, name)
        yield embedding


def _recipe(photo: Photo, settings: MaskSettings) -> str:
    return stage_key(_METHOD_VERSION, photo.sha256, to_dict(settings))
