"""A trained scene with its photos, ready for prompts; what is computed for one prompt is reused for the next."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from ..core.arrays import Float32, Int32, Mask
from ..core.errors import Cancelled, EnvironmentProblem, FormatError
from ..core.events import Emit, Progress, StopCheck, Warned, ignore_events, never_stop, part_of
from ..core.label_runs import LabelRuns
from ..core.parts import part
from ..pictures import Scene
from ..project.folder import ProjectFolder
from ..project.own_words import OwnWords
from ..rasterizer import PROCESSOR, Device, device_words, fallback
from ..scene import CameraSet, Gaussians
from .graph import SceneGraph
from .graph_file import load_or_build_graph, read_graph
from .known_objects import stored_memberships
from .photos import Photos, SamFactory
from .settings import MEMBER_THRESHOLD, SegmentSettings
from .support import Surfaces, horizontal_surfaces
from .views import Views

if TYPE_CHECKING:
    from .grounding import Detector

_KEPT_BYTES = 64 << 20
"""Largest memory of the label maps that are kept."""

DetectorFactory = Callable[[], "Detector"]

Made = TypeVar("Made")


@dataclass(frozen=True)
class SegmentationContext:
    """A trained scene with what is needed to isolate objects of it.

    Attributes
    ----------
    views : Views
    photos : Photos
    label_maps : mapping of str to array of shape [h, w], int32
        SAM's, by photo; there may be none.
    settings : SegmentSettings
    detector_factory : callable
        Called when a detector is first needed.
    emit, should_stop : callable
        See `engine.core.events`.
    folder : Path or None
        Where what is computed once for all prompts is kept on disk; None keeps it in memory alone.
    kept : dict
        The same in memory, by name.
    own_words : OwnWords or None
        The user's own vocabulary; None in a project that does not learn.
    stored : callable
        Returns the Gaussians, bool [N], of the objects that are stored now, but of the background, by id.
    """

    views: Views
    photos: Photos
    label_maps: Mapping[str, Int32]
    settings: SegmentSettings
    detector_factory: DetectorFactory
    emit: Emit = ignore_events
    should_stop: StopCheck = never_stop
    folder: Path | None = None
    kept: dict[str, Any] = field(default_factory=dict, compare=False, repr=False)
    own_words: OwnWords | None = None
    stored: Callable[[], Mapping[str, Mask]] = dict

    def once(self, name: str, make: Callable[[], Made]) -> Made:
        """Return what `make` returned when this was first called with `name`."""
        if name not in self.kept:
            self.kept[name] = make()
        return self.kept[name]

    @property
    def detector(self) -> Detector:
        """The detector, made at its first use."""
        with part("loading models"):
            return self.once("detector", self.detector_factory)

    def taught(self, word: str) -> tuple[Float32, Float32]:
        """Return `OwnWords.means_of` of a word; no rows where the project does not learn.

        Raises
        ------
        FormatError
            When the user's own vocabulary is damaged.
        """
        if self.own_words is None or not self.detector.fingerprint:
            return np.zeros((0, 1), np.float32), np.zeros((0, 1), np.float32)
        return self.own_words.means_of(word, self.detector.fingerprint)

    @property
    def graph(self) -> SceneGraph:
        """The graph of the scene, made at its first use. Raises `Cancelled` when that is stopped."""
        with part("graph"):
            return self.once("graph", lambda: load_or_build_graph(
                self._graph_file, self.views, self.label_maps,
                n_views=self.settings.n_vote_views, should_stop=self.should_stop,
            ))  # fmt: skip

    @property
    def _graph_file(self) -> Path | None:
        return None if self.folder is None else self.folder / "graph.npz"

    def with_kept_graph(self, key: str) -> SegmentationContext:
        """Return the context with the graph of this key, if it is kept: no segment needs to be read to know that."""
        graph = None if self._graph_file is None else read_graph(self._graph_file, key, len(self.means))
        return self if graph is None else replace(self, kept={**self.kept, "graph": graph})

    @property
    def means(self) -> Float32:
        """Positions of the N Gaussians, [N, 3]."""
        return self.views.scene.gaussians.means

    @property
    def surfaces(self) -> Surfaces:
        """The horizontal surfaces of the scene, found at their first use."""
        return self.once("surfaces", lambda: horizontal_surfaces(self.views.scene.gaussians))

    def part(self, number: int, count: int) -> SegmentationContext:
        """Return the context for step `number` of `count` equal ones, as the progress tells them."""
        return replace(self, emit=part_of(self.emit, number, count))

    def tell(self, fraction: float, message: str, seconds_left: float | None = None) -> None:
        """Emit the progress.

        Parameters
        ----------
        fraction : float
            0 to 1.
        seconds_left : float or None
            None where it is not known.

        Raises
        ------
        Cancelled
            When the user stops.
        """
        self.emit(Progress("objects", fraction, seconds_left=seconds_left, message=message))
        self.check_stop()

    def check_stop(self) -> None:
        """Raise `Cancelled` when the user stops."""
        if self.should_stop():
            raise Cancelled("Stopped while isolating; no object was stored.")


def load_context(
    project: ProjectFolder,
    settings: SegmentSettings,
    detector_factory: DetectorFactory,
    sam_factory: SamFactory,
    *,
    device: Device = PROCESSOR,
    own_words: OwnWords | None = None,
    emit: Emit = ignore_events,
    should_stop: StopCheck = never_stop,
) -> SegmentationContext:
    """Return the context of a trained project.

    Parameters
    ----------
    device : Device
        Renders the views, counts the votes and makes the steps of detail. What is stored does not depend on it, but for
        rounding, and in detail for which Gaussians were drawn to be split.
    own_words : OwnWords or None
        See `SegmentationContext`.

    Raises
    ------
    HeritageError
        When a part of the project is missing or damaged.
    """
    from ..masks import EmbeddingFolder
    from ..scene import read_camera_set
    from ..training import load_gaussians

    project.require_intact("cameras", "training")
    cameras = read_camera_set(project.path / "cameras")

    def stored() -> dict[str, Mask]:
        each = stored_memberships(project.path, len(scene))
        return {key: membership >= MEMBER_THRESHOLD for key, membership in each.items()}

    scene = scene_on(device, load_gaussians(project.path / "gaussians"), emit)
    return SegmentationContext(
        Views(scene, cameras, render_side=settings.render_side),
        Photos(photo_folder_of(project), settings, sam_factory, EmbeddingFolder(project.path / "masks")),
        label_maps_of(project.path, cameras),
        settings,
        detector_factory,
        emit,
        should_stop,
        project.path / "groups",
        own_words=own_words,
        stored=stored,
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


def label_maps_of(project: Path, cameras: CameraSet) -> Mapping[str, Int32]:
    """Return the SAM label maps that were made for training, by photo, each read when it is used.

    Those used last are kept, as runs of equal labels, in at most `_KEPT_BYTES` of memory.
    """
    from ..masks import label_map_path

    files = {camera.photo: label_map_path(project / "masks", camera.photo) for camera in cameras.cameras}
    return _LabelMaps({photo: file for photo, file in files.items() if file.is_file()})


class _LabelMaps(Mapping[str, Int32]):
    """The label maps in files by photo. Used by one thread."""

    def __init__(self, files: Mapping[str, Path]) -> None:
        self._files, self._kept = files, OrderedDict[str, LabelRuns]()

    def __getitem__(self, photo: str) -> Int32:
        from ..masks import read_label_map

        runs = self._kept.pop(photo, None)
        if runs is not None:
            self._kept[photo] = runs
            return runs.array()
        labels = read_label_map(self._files[photo])
        self._kept[photo] = LabelRuns.of(labels)
        while self.n_bytes > _KEPT_BYTES:
            self._kept.popitem(last=False)
        return labels

    @property
    def n_bytes(self) -> int:
        """Bytes of memory of what is kept."""
        return sum(one.nbytes for one in self._kept.values())

    def __iter__(self) -> Iterator[str]:
        return iter(self._files)

    def __len__(self) -> int:
        return len(self._files)
