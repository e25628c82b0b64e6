"""A trained scene with its photos, ready for prompts; what is computed for one prompt is reused for the next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import EnvironmentProblem, FormatError
from ..events import Emit, Progress, StopCheck, Warned, ignore_events
from ..pictures import Scene
from ..project_folder import ProjectFolder
from ..rasterizer import PROCESSOR, Device, device_words, fallback
from ..scene import CameraSet, Gaussians
from .graph import SceneGraph, load_or_build_graph
from .looks import Looks, build_looks, load_or_build_looks
from .photos import Photos, SamFactory
from .settings import SegmentSettings
from .views import Views

if TYPE_CHECKING:
    from ..grounding import Detector

__all__ = ["SegmentationContext", "label_maps_of", "load_context", "photo_folder_of", "scene_on"]

_LOOKS_FILE = Path("groups") / "looks.npz"
"""Path of the stored looks of the proposals, relative to the project folder."""

_GRAPH_FILE = Path("groups") / "graph.npz"
"""Path of the stored graph of the scene, relative to the project folder."""


@dataclass(frozen=True)
class SegmentationContext:
    """A trained scene with rendered views, photos, SAM's embeddings, its graph and its proposals.

    Attributes
    ----------
    views : Views
    photos : Photos
    label_maps : mapping of str to int32 array of shape [h, w]
        SAM label maps by photo; may be empty.
    looks_file : Path or None
        File that stores the looks of the proposals (`engine.objects.looks`). None keeps them in memory only.
    graph_file : Path or None
        File that stores the graph of the scene (`engine.objects.graph`). None keeps it in memory only.
    graphs : dict of int to SceneGraph
        Graphs in memory by number of photos.
    """

    views: Views
    photos: Photos
    label_maps: Mapping[str, NDArray[np.int32]]
    looks_file: Path | None = None
    graph_file: Path | None = None
    graphs: dict[int, SceneGraph] = field(default_factory=dict, compare=False, repr=False)
    _looks: dict[str, Looks] = field(default_factory=dict, compare=False, repr=False)

    def graph(self, settings: SegmentSettings, should_stop: StopCheck) -> SceneGraph:
        """Return the graph of the scene, made at the first call with these `n_vote_views`.

        Raises
        ------
        Cancelled
            When `should_stop` returns True.
        """
        n_views = settings.n_vote_views
        if n_views not in self.graphs:
            self.graphs[n_views] = load_or_build_graph(
                self.graph_file, self.views, self.label_maps, n_views=n_views, should_stop=should_stop
            )
        return self.graphs[n_views]

    def looks(self, detector: Detector, settings: SegmentSettings, *, emit: Emit, should_stop: StopCheck) -> Looks:
        """Return what may be an object, as `detector` describes it, made at the first call.

        Raises
        ------
        Cancelled
            When `should_stop` returns True.
        """
        if detector.name not in self._looks:
            given = (self.views, self.graph(settings, should_stop), self.photos, detector, settings)
            self._looks[detector.name] = (
                build_looks(*given, emit=emit, should_stop=should_stop)
                if self.looks_file is None
                else load_or_build_looks(self.looks_file, *given, emit=emit, should_stop=should_stop)
            )
        return self._looks[detector.name]


def load_context(
    project: ProjectFolder,
    settings: SegmentSettings,
    sam_factory: SamFactory,
    *,
    device: Device = PROCESSOR,
    emit: Emit = ignore_events,
) -> SegmentationContext:
    """Return the context of a trained project.

    Parameters
    ----------
    project : ProjectFolder
    settings : SegmentSettings
        `render_side` and `photo_side`.
    sam_factory : callable
        Called when SAM is first needed.
    device : Device
        What renders the views and counts the votes. What is stored does not depend on it, but for rounding.
    emit : callable
        Told the device, and that the processor replaces it.

    Raises
    ------
    HeritageError
        When a part of the project is missing or damaged.
    """
    from ..gaussians import load_gaussians
    from ..masks import EmbeddingFolder
    from ..scene import read_camera_set

    project.require_intact("cameras", "training")
    cameras = read_camera_set(project.path / "cameras")
    scene = scene_on(device, load_gaussians(project.path / "gaussians"), emit)
    return SegmentationContext(
        Views(scene, cameras, render_side=settings.render_side),
        Photos(photo_folder_of(project), settings.photo_side, sam_factory, EmbeddingFolder(project.path / "masks")),
        label_maps_of(project.path, cameras),
        project.path / _LOOKS_FILE,
        project.path / _GRAPH_FILE,
    )


def scene_on(device: Device, gaussians: Gaussians, emit: Emit) -> Scene:
    """Return a scene that is rendered on `device`; on the processor, if a card that is not required fails."""

    def warn(problem: EnvironmentProblem) -> None:
        processor = fallback(problem)
        emit(Warned(f"The rest is rendered on {device_words(processor.name, processor.reason)}."))

    if device.backend == "gpu" or device.reason:
        emit(Progress("objects", 0.0, message=f"rendering on {device_words(device.name, device.reason)}"))
    return Scene(gaussians, backend=device.backend, on_failure=None if device.required else warn)


def photo_folder_of(project: ProjectFolder) -> Path:
    """Return the folder of a project's photos.

    Raises
    ------
    FormatError
        When the project does not name it.
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
