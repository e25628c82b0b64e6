"""A first picture of the scene, long before training, made by a process of its own while the cameras are estimated.

Some of the photos get cameras from a few coarse features, and a small training shows the scene as these photos see it.
Nothing of it goes into the project, and what the run makes does not depend on it. Who follows the run sees it as any
other preview.
"""

from __future__ import annotations

import contextlib
import logging
import threading
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any

from ..cameras.settings import CameraModel, CameraSettings
from ..core.child_process import ChildrenBeside
from ..core.errors import HeritageError
from ..core.events import Emit, Preview, StopCheck, ignore_events, never_stop
from ..core.files import delete_derived
from ..core.parts import part
from ..scene import PhotoSet
from ..training.settings import PRESETS, PREVIEW_FILE

_LOG = logging.getLogger(__name__)

FOLDER = "first_picture"
"""Name of its folder in the project; there is none after the run."""

MIN_PHOTOS = 32
"""Smallest number of photos of a scene that gets such a picture. The cameras of fewer are soon known."""
_PHOTOS = 16  # chosen on museum_room
"""Number of photos that it is made of."""
_CAMERAS = CameraSettings(max_side=640, max_features=1200, first_octave=0, threads=1)  # chosen on museum_room
_TRAINING = PRESETS["preview"].changed(
    steps=300, max_side=320, max_gaussians=8_000, sh_degree=0, exposure=False, train_features=False,
    curve_points=2, preview_seconds=3.0, held_out_every=0, coarse_levels=1,
)  # fmt: skip  # chosen on museum_room


class FirstPicture(ChildrenBeside):
    """Makes the picture from `start` to `end`; a context at whose end the process is dead and its files are deleted.

    Parameters
    ----------
    photo_set : PhotoSet
        As the project stores it.
    lens : str
        Lens model, see `CameraSettings.model`.
    emit : Emit
        Receives a `Preview` for each state of the picture.
    """

    def __init__(self, project: Path, photo_set: PhotoSet, lens: CameraModel, emit: Emit) -> None:
        super().__init__()
        self._project, self._emit = project, emit
        names = sorted(photo.name for photo in photo_set.photos)
        self._arguments = {
            "photos_file": str(project / "photos" / "photos.json"),
            "photo_folder": str(photo_set.folder),
            "names": [names[round(k * (len(names) - 1) / (_PHOTOS - 1))] for k in range(_PHOTOS)],
            "folder": str(project / FOLDER),
            "lens": lens,
        }
        self._seen = 0
        self._looking = threading.Lock()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        super().__exit__(kind, error, traceback)
        delete_derived(self._project, FOLDER)

    def start(self) -> None:
        """Start the process."""
        delete_derived(self._project, FOLDER)
        self.begin("pipeline.first_picture:make_first_picture", self._arguments, what="making a first picture")

    def watched_by(self, should_stop: StopCheck) -> StopCheck:
        """Return `should_stop` that also emits a `Preview` when there is a new picture."""

        def look_and_ask() -> bool:
            if self._children:
                self._look()
            return should_stop()

        return look_and_ask

    def _look(self) -> None:
        # Several threads ask: one of them looks.
        if not self._looking.acquire(blocking=False):
            return
        file = self._project / FOLDER / PREVIEW_FILE
        try:
            with contextlib.suppress(FileNotFoundError):
                changed = file.stat().st_mtime_ns
                if changed != self._seen:
                    self._seen = changed
                    self._emit(Preview("cameras", str(file)))
        finally:
            self._looking.release()

    def end(self) -> None:
        """End the process: the training shows its own pictures. The last picture stays until the context ends."""
        for child in self.take():
            with part("first picture"):
                try:
                    child.end()
                except HeritageError as error:
                    # Too few of these photos overlap, which says nothing about all photos.
                    _LOG.info("There was no first picture of the scene: %s", error)


def make_first_picture(
    photos_file: str, photo_folder: str, names: list[str], folder: str, lens: CameraModel
) -> dict[str, Any]:
    """Write the picture into `folder`, at first after some steps, and return the number of cameras, `n_cameras`.

    Parameters
    ----------
    photos_file : str
        The project's ``photos.json``.
    names : list of str
        Photos to use.
    folder : str
        For the picture and what is needed for it.
    lens : str
        Lens model.

    Raises
    ------
    HeritageError
        As `estimate_cameras` and `train`.
    """
    from ..cameras import estimate_cameras
    from ..scene import read_photo_set
    from ..training import background_gaussians, load_views, start_gaussians, train

    photo_set = replace(read_photo_set(Path(photos_file)), folder=Path(photo_folder))
    chosen = replace(photo_set, photos=tuple(photo for photo in photo_set.photos if photo.name in names))
    cameras = estimate_cameras(chosen, Path(folder) / "sfm", replace(_CAMERAS, model=lens))
    views = load_views(chosen.folder, cameras, {}, _TRAINING, photo_masks=chosen.mask_files)
    train(
        start_gaussians(cameras, views, _TRAINING, emit=ignore_events), views, _TRAINING, checkpoints=Path(folder),
        emit=ignore_events, should_stop=never_stop, background=background_gaussians(cameras.points, views, _TRAINING),
    )  # fmt: skip
    return {"n_cameras": len(cameras.cameras)}
