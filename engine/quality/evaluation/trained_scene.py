"""A trained scene from which objects are isolated without looking at the photos that they are compared in."""

from __future__ import annotations

import time
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Mask
from ...core.errors import PromptError, SettingsError
from ...core.events import Emit, StopCheck, ignore_events
from ...masks import EmbeddingFolder
from ...objects import (
    ClickPrompt,
    DetectorFactory,
    MaskPrompt,
    NoMatchError,
    Photos,
    Prompt,
    SamFactory,
    SceneGraph,
    SegmentationContext,
    TextPrompt,
    Views,
    find_everything,
    find_objects,
    label_maps_of,
    photo_folder_of,
    scene_on,
)
from ...objects.settings import PaperSettings, SegmentSettings
from ...pictures import Scene, write_png
from ...project.folder import ProjectFolder
from ...rasterizer import PROCESSOR, Device
from ...scene import CameraSet
from ...training import load_gaussians
from .comparison import resized
from .ground_truth import GroundTruth
from .settings import Method, PromptKind


@dataclass(frozen=True)
class Question:
    """The question that every method is asked.

    Attributes
    ----------
    kind : {"text", "mask", "click", "all"}
    name : str
        The text; the object of a true mask or a click; for all objects, a description.
    prompt_photo : str or None
        Photo of the true mask or the click.
    """

    kind: PromptKind
    name: str
    prompt_photo: str | None = None


@dataclass(frozen=True)
class Answer:
    """The answer of a method.

    Attributes
    ----------
    found : tuple of bool arrays of shape [N]
        The Gaussians of each result, the best first.
    scores : tuple of float
        Of each result.
    names : tuple of str
        Names that the method suggests for the results of a search for all objects; else empty texts.
    seconds, cpu_seconds : float
    refusal : str
        Reason why there are no results.
    best_score : float
        Score of the best candidate of a text without results; NaN without one.
    offered : tuple of bool arrays of shape [N]
        The Gaussians of what a refused text is answered with as pictures, the best first.
    """

    found: tuple[Mask, ...]
    scores: tuple[float, ...]
    names: tuple[str, ...]
    seconds: float
    cpu_seconds: float
    refusal: str = ""
    best_score: float = float("nan")
    offered: tuple[Mask, ...] = ()


class TrainedScene:
    """A trained scene, and the photos that isolating may look at.

    The cameras of all other photos are missing from the segmentation contexts, and their label maps and embeddings are
    not read. So no step of isolating an object can render, read or segment them.

    Parameters
    ----------
    project : ProjectFolder
        Trained; only read.
    cameras : CameraSet
        All cameras of the project.
    hidden : collection of str
        Photos that isolating must not look at.
    folder : Path
        Folder for what is computed once for several prompts.
    detector_factory, sam_factory : callable
        Called when their model is first needed.
    device, emit
        See `engine.objects.load_context`.

    Raises
    ------
    SettingsError
        When all photos are hidden.
    HeritageError
        When a part of the project is missing or damaged.
    """

    def __init__(
        self,
        project: ProjectFolder,
        cameras: CameraSet,
        hidden: Collection[str],
        folder: Path,
        detector_factory: DetectorFactory,
        sam_factory: SamFactory,
        *,
        device: Device = PROCESSOR,
        emit: Emit = ignore_events,
    ) -> None:
        self.gaussians = load_gaussians(project.path / "gaussians")
        self._scene = scene_on(device, self.gaussians, emit)
        self.photo_folder = photo_folder_of(project)
        self.camera_of = cameras.by_photo
        self.looked_at = tuple(photo for photo in self.camera_of if photo not in hidden)
        if not self.looked_at:
            raise SettingsError("Every photo is compared, so none is left to isolate objects from. Use --views all.")
        self._cameras = cameras
        self._label_maps = label_maps_of(project.path, self._visible_cameras(None))
        self._embeddings = EmbeddingFolder(project.path / "masks").copied(folder / "embeddings", self.looked_at)
        # What is computed once is kept here, as in a project; the project itself is only read.
        self._folder = folder
        self._graphs: dict[int, SceneGraph] = {}
        self._prompt_file = folder / "prompt.png"
        self._detector_factory, self._sam_factory = detector_factory, sam_factory

    def answer(self, question: Question, method: Method, truth: GroundTruth, should_stop: StopCheck) -> Answer:
        """Return the answer of a method.

        Raises
        ------
        Cancelled
            When `should_stop` returns True.
        MaskError
            When the true mask of the prompt cannot be read, or has another aspect ratio than its photo.
        """
        prompt = None if question.kind == "all" else self._prompt(question, truth)
        found, refusal, best_score = [], "", float("nan")
        offered: tuple[Mask, ...] = ()
        started, started_cpu = time.perf_counter(), time.process_time()
        context = self._context(method, question.prompt_photo, should_stop)
        if prompt is None:
            found = find_everything(context)
        else:
            try:
                found = find_objects(context, prompt)
            except PromptError as error:
                refusal = str(error)
                if isinstance(error, NoMatchError) and error.candidates:
                    best_score = error.candidates[0].score
                    offered = tuple(one.members for one in error.candidates if one.members is not None)
        seconds, cpu_seconds = time.perf_counter() - started, time.process_time() - started_cpu
        members, scores = tuple(one.members for one in found), tuple(one.score for one in found)
        names = tuple(one.name for one in found)
        return Answer(members, scores, names, seconds, cpu_seconds, refusal, best_score, offered)

    def photos(self, settings: SegmentSettings) -> Photos:
        """Return the photos at the size that the models get."""
        return Photos(self.photo_folder, settings, self._sam_factory, self._embeddings)

    def new_scene(self) -> Scene:
        """Return the scene without anything that was rendered before."""
        return self._scene.with_gaussians(self.gaussians)

    def _context(self, method: Method, prompt_photo: str | None, should_stop: StopCheck) -> SegmentationContext:
        settings = method.settings
        views = Views(self.new_scene(), self._visible_cameras(prompt_photo), render_side=settings.render_side)
        context = SegmentationContext(
            views, self.photos(settings), self._label_maps, settings, self._detector_factory,
            should_stop=should_stop, folder=self._folder,
        )  # fmt: skip
        if isinstance(settings, PaperSettings):
            return context
        if settings.n_vote_views not in self._graphs:
            self._graphs[settings.n_vote_views] = context.graph
        graph = self._graphs[settings.n_vote_views]
        return replace(context, kept={"graph": graph.without(method.without) if method.without else graph})

    def _visible_cameras(self, prompt_photo: str | None) -> CameraSet:
        """Return the cameras of the photos that may be looked at, and of the photo of a prompt."""
        visible = {*self.looked_at, prompt_photo}
        return replace(
            self._cameras, cameras=tuple(camera for camera in self._cameras.cameras if camera.photo in visible)
        )

    def _prompt(self, question: Question, truth: GroundTruth) -> Prompt:
        if question.prompt_photo is None:
            return TextPrompt(question.name)
        photo = question.prompt_photo
        camera = self.camera_of[photo]
        mask = resized(truth.masks(photo)[question.name], (camera.height, camera.width), photo)
        if question.kind == "click":
            y, x = innermost_pixel(mask)
            return ClickPrompt(photo, x, y)
        write_png(self._prompt_file, np.where(mask, np.uint8(255), np.uint8(0)))
        return MaskPrompt(photo, self._prompt_file)


def innermost_pixel(segment: NDArray[np.bool_]) -> tuple[int, int]:
    """Return row and column of the pixel of `segment` farthest from its border and that of the picture."""
    framed = np.pad(segment.astype(np.uint8), 1)
    distance = cv2.distanceTransform(framed, cv2.DIST_L2, 3)[1:-1, 1:-1]
    y, x = np.unravel_index(int(np.argmax(distance)), segment.shape)
    return int(y), int(x)
