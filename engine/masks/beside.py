"""Label maps that processes of their own make: while the cameras are estimated, and on helpers.

A label map depends on its photo only, and COLMAP places the photos on one core. The children divide the photos that
will need label maps if all are placed; the masks stage then makes those that are missing. A child that is killed loses
one photo's work.
"""

from __future__ import annotations

import functools
import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..core.child_process import ChildrenBeside
from ..core.errors import HeritageError
from ..core.events import Emit, Progress, StopCheck, never_stop
from ..core.files import delete_derived
from ..core.settings import to_dict
from ..core.shares import Need, count_taken, helper_places, run_shares, taken_items
from ..core.system import PeakMemory, lower_priority
from ..scene import PhotoSet
from .settings import SAM_MODELS, MaskSettings
from .stage import make_masks, stale_photos
from .storage import label_map_path

_LOG = logging.getLogger(__name__)
MIN_PHOTOS_EACH = 4
"""Smallest number of photos of a child where there are several: each loads SAM, which takes as long as a photo."""
_NEED = Need(cores=2, memory=1_000_000_000)
"""Of a share on a helper: the next photo is encoded while a photo's clicks are decoded."""
_IN_CHILD, _WHAT = "masks.beside:make_masks_in_child", "segmenting photos"
_NICENESS = 10
"""The cameras come first where both want a core."""


@dataclass(frozen=True)
class BesideCost:
    """Cost of the child processes.

    Attributes
    ----------
    seconds : float
        Wall seconds until the last one ended.
    peak_memory : int or None
        Bytes of the largest, None when one did not finish or where the system does not report it.
    n_kept : int
        Label maps that were there before, of an earlier run.
    problem : str
        Why one made nothing more, as a sentence; empty when nothing failed.
    """

    seconds: float
    n_kept: int
    peak_memory: int | None = None
    problem: str = ""


class MasksBeside(ChildrenBeside):
    """Makes label maps in child processes from `start` to `end`; a context at whose end they are dead.

    Parameters
    ----------
    photos_file : Path
        The project's ``photos.json``.
    names : sequence of str
        Photos to segment.
    folder : Path
        The project's ``masks`` folder.
    n_processes : int
        Largest number of children. What a photo gets does not depend on it.
    """

    def __init__(
        self,
        photos_file: Path,
        photo_folder: Path,
        names: Sequence[str],
        folder: Path,
        settings: MaskSettings,
        *,
        n_processes: int = 1,
    ) -> None:
        super().__init__()
        self._arguments = _arguments(photos_file, photo_folder, folder, settings)
        count = max(1, min(n_processes, len(names) // MIN_PHOTOS_EACH))
        self._shares = [list(names[number::count]) for number in range(count)]
        self._label_maps = [label_map_path(folder, name) for name in names]
        self._started, self._n_kept = 0.0, 0

    def start(self) -> None:
        """Start the children."""
        self._n_kept = sum(path.exists() for path in self._label_maps)
        for names in self._shares:
            self.begin(_IN_CHILD, {**self._arguments, "batches": [names]}, what=_WHAT)
        self._started = time.perf_counter()

    def end(self) -> BesideCost | None:
        """End the children and return their cost, None when none were started. Some label maps may be missing."""
        children = self.take()
        if not children:
            return None
        so_far = time.perf_counter() - self._started
        seconds, memory, problem = [], list[int | None](), ""
        for child in children:
            answer = None
            try:
                answer = child.end()
            except HeritageError as error:
                # What keeps the photos from being segmented stops the masks stage too, which says it as an error.
                _LOG.warning("No more label maps were made while the cameras were estimated: %s", error)
                problem = problem or str(error)
            seconds.append(answer["seconds"] if answer else so_far)
            memory.append(answer["peak_memory"] if answer else None)
        peak = None if None in memory else max(one or 0 for one in memory)
        return BesideCost(max(seconds), self._n_kept, peak, problem)


def _arguments(photos_file: Path, photo_folder: Path, folder: Path, settings: MaskSettings) -> dict[str, Any]:
    return {
        "photos_file": str(photos_file), "photo_folder": str(photo_folder), "folder": str(folder),
        "settings": to_dict(settings),
    }  # fmt: skip


def make_masks_with_helpers(
    photo_set: PhotoSet,
    photos_file: Path,
    names: Sequence[str],
    folder: Path,
    settings: MaskSettings,
    *,
    emit: Emit,
    should_stop: StopCheck,
) -> None:
    """Make label maps here and on helpers, where some are free; see `make_masks`, which then makes what is missing.

    `photos_file` is the project's ``photos.json``.
    """
    stale = stale_photos(photo_set, names, folder, settings)
    if len(stale) < 2 * MIN_PHOTOS_EACH or not helper_places(_NEED):
        return
    # Beside the folder, in which photos may have any names.
    shares = folder.with_name("mask_shares")
    batches = [stale[start : start + MIN_PHOTOS_EACH] for start in range(0, len(stale), MIN_PHOTOS_EACH)]
    delete_derived(shares.parent, shares.name)

    def tell() -> None:
        emit(Progress("masks", count_taken(shares) / len(batches), message="segmenting on several computers"))

    given = {**_arguments(photos_file, photo_set.folder, folder, settings), "batches": batches, "shares": str(shares)}
    try:
        run_shares(
            _IN_CHILD, given, len(batches), _NEED,
            folder=shares, what=_WHAT, processes=1, watch=tell, should_stop=should_stop,
        )  # fmt: skip
    finally:
        delete_derived(shares.parent, shares.name)


def make_masks_in_child(
    photos_file: str,
    photo_folder: str,
    folder: str,
    settings: dict[str, Any],
    batches: list[list[str]],
    shares: str = "",
) -> dict[str, Any]:
    """Make label maps and return `seconds` and `peak_memory` of `BesideCost`.

    The parameters are described at `MasksBeside`; here they are JSON values. Of the `batches` of photos, those are
    segmented that no other process has taken in the folder `shares`; without it, all.

    Raises
    ------
    HeritageError
        As `make_masks` and `load_sam`.
    """
    from ..scene import read_photo_set
    from .sam import load_sam

    lower_priority(_NICENESS)
    start, chosen = time.perf_counter(), MaskSettings(**settings)
    with PeakMemory.of() as peak:
        photo_set = replace(read_photo_set(Path(photos_file)), folder=Path(photo_folder))
        # Cards are left to the masks stage, which tries them first and reports which device encodes.
        load = functools.cache(lambda: load_sam(chosen.model, threads=sam_threads(chosen), may_use_gpu=False))
        for number in taken_items(Path(shares), len(batches)) if shares else range(len(batches)):
            make_masks(
                photo_set, batches[number], Path(folder), chosen, load,
                emit=lambda event: None, should_stop=never_stop,
            )  # fmt: skip
    return {"seconds": time.perf_counter() - start, "peak_memory": peak.bytes}


def sam_threads(settings: MaskSettings) -> int:
    """Return the worker threads of SAM in the masks stage.

    The default model takes as long for the clicks of a photo as for encoding the next, which runs in parallel; the
    encoders of the others take longer.
    """
    return 1 if settings.model == SAM_MODELS[0] else 2
