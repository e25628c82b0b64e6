"""A trained scene, ready for prompts: what one prompt makes of it is there for the next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import FormatError
from ..events import Emit, StopCheck
from ..pictures import Backend, Scene
from ..project_folder import ProjectFolder
from ..scene import CameraSet
from .looks import GroupLooks, load_or_make_looks, make_looks
from .photos import Photos, SamFactory
from .settings import SegmentSettings
from .views import Views

if TYPE_CHECKING:
    from ..grounding import Detector

__all__ = ["SegmentationContext", "label_maps_of", "load_context", "photo_folder_of"]

_LOOKS_FILE = Path("groups") / "looks.npz"
"""In a project."""


@dataclass(frozen=True)
class SegmentationContext:
    """A trained scene and what is remembered of it from prompt to prompt: rendered views, photos, SAM's embeddings.

    Attributes
    ----------
    views : Views
    photos : Photos
    label_maps : mapping of str to int32 array of shape [h, w]
        SAM label maps by photo.
    looks_file : Path or None
        Where what its groups look like is kept (`engine.objects.looks`).
    """

    views: Views
    photos: Photos
    label_maps: Mapping[str, NDArray[np.int32]]
    looks_file: Path | None = None
    _looks: dict[str, GroupLooks | None] = field(default_factory=dict, compare=False, repr=False)

    def looks(self, detector: Detector, *, emit: Emit, should_stop: StopCheck) -> GroupLooks | None:
        """Return what the scene's groups look like to `detector`, made when first asked for.

        Raises
        ------
        Cancelled
            When `should_stop` says so.
        """
        if detector.name not in self._looks:
            self._looks[detector.name] = (
                make_looks(self.views, self.photos, detector, emit=emit, should_stop=should_stop)
                if self.looks_file is None
                else load_or_make_looks(
                    self.looks_file, self.views, self.photos, detector, emit=emit, should_stop=should_stop
                )
            )
        return self._looks[detector.name]


def load_context(
    project: ProjectFolder, settings: SegmentSettings, sam_factory: SamFactory, *, backend: Backend = "cpu"
) -> SegmentationContext:
    """Return what `project` holds.

    Raises
    ------
    HeritageError
        When a part of the project is missing or damaged.
    """
    from ..gaussians import load_gaussians
    from ..masks import EmbeddingFolder
    from ..scene import read_camera_set

    cameras = read_camera_set(project.path / "cameras")
    scene = Scene(load_gaussians(project.path / "gaussians"), backend=backend)
    return SegmentationContext(
        Views(scene, cameras, render_side=settings.render_side),
        Photos(photo_folder_of(project), settings.photo_side, sam_factory, EmbeddingFolder(project.path / "masks")),
        label_maps_of(project.path, cameras),
        project.path / _LOOKS_FILE,
    )


def photo_folder_of(project: ProjectFolder) -> Path:
    """Return where the photos of a project are.

    Raises
    ------
    FormatError
        When the project does not say.
    """
    folder = project.get("photo_folder")
    if not isinstance(folder, str):
        raise FormatError(f"{project.path / 'project.json'} does not say where the photos are. Reconstruct again.")
    return Path(folder)


def label_maps_of(project: Path, cameras: CameraSet) -> dict[str, NDArray[np.int32]]:
    """Return the SAM label maps that were made for training, by photo."""
    from ..masks import label_map_path, read_label_map

    files = {camera.photo: label_map_path(project / "masks", camera.photo) for camera in cameras.cameras}
    return {photo: read_label_map(file) for photo, file in files.items() if file.is_file()}
