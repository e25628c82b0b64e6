"""Isolates the objects of a trained project with several methods and compares them with the true masks."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from ..cameras import covering_pinhole, distort
from ..errors import Cancelled, MaskError, PromptError, SettingsError
from ..events import Emit, Progress, StopCheck, Warned, ignore_events
from ..gaussians import load_gaussians
from ..objects import (
    THRESHOLD,
    ClickPrompt,
    DetectorFactory,
    MaskPrompt,
    Photos,
    Prompt,
    SamFactory,
    SegmentationContext,
    TextPrompt,
    Views,
    find_objects,
    label_maps_of,
    photo_folder_of,
)
from ..photos import load_pixels
from ..pictures import Scene, render_view, write_png
from ..project_folder import ProjectFolder
from ..scene import Camera, CameraSet, Gaussians, read_camera_set
from .gaussian_truth import gaussian_iou, gaussian_truth
from .ground_truth import GroundTruth, Layout, read_ground_truth
from .image_metrics import psnr
from .mask_metrics import boundary_iou, halo, holes, iou, stray
from .segment_agreement import innermost_pixel
from .settings import EvaluationSettings, Method, PromptKind, methods_of

__all__ = ["Evaluation", "Row", "evaluate_project", "mean_of", "visible_masks"]

STAGE = "evaluation"
Mask = NDArray[np.bool_]

_MAX_OBJECTS_PER_PASS = 16
"""Objects rendered in one pass. Each needs one float per pixel."""
_ISOLATION_SHARE = 0.8
"""Share of the progress bar that isolating takes; comparing takes the rest."""
_MAX_ASPECT_DEVIATION = 0.02
"""Largest relative difference of the aspect ratios of a photo and its mask."""


@dataclass(frozen=True)
class Row:
    """One object, isolated with one method. Shares are 0 to 1, means over the views; NaN where nothing was measured.

    Attributes
    ----------
    object : str
    method : str
    found : bool
        Whether the object was found. If not, `iou` and `boundary_iou` are 0 and `holes` is 1.
    iou, boundary_iou, halo, stray, holes : float
        See `engine.evaluation.mask_metrics`.
    psnr : float
        PSNR in dB between the object rendered alone on black and the photo, within the true mask.
    gaussian_iou : float
        See `engine.evaluation.gaussian_truth`.
    seconds, cpu_seconds : float
        Time from the prompt to the Gaussians.
    n_views : int
    prompt_photo : str
        Photo of the true mask or the click; empty for a text.
    remark : str
        Reason why nothing was found.
    """

    object: str
    method: str
    found: bool
    iou: float
    boundary_iou: float
    halo: float
    stray: float
    holes: float
    psnr: float
    gaussian_iou: float
    seconds: float
    cpu_seconds: float
    n_views: int
    prompt_photo: str
    remark: str = ""


@dataclass(frozen=True)
class Evaluation:
    """Results of an evaluation, object by object, and the data that they were measured on.

    Attributes
    ----------
    rows : tuple of Row
    settings : EvaluationSettings
    layout : str
        Layout of the true masks.
    photos : tuple of str
        Evaluated photos.
    n_trained_on : int
        Number of `photos` that training saw.
    unplaced : tuple of str
        Views with true masks that were left out, since they have no camera.
    left_out : tuple of str
        Objects that were left out, since no photo is left to evaluate them in.
    n_gaussians : int
    stages : tuple of (str, float, float)
        Stage, wall seconds and CPU seconds of the run that made the project.
    """

    rows: tuple[Row, ...]
    settings: EvaluationSettings
    layout: Layout
    photos: tuple[str, ...]
    n_trained_on: int
    unplaced: tuple[str, ...]
    left_out: tuple[str, ...]
    n_gaussians: int
    stages: tuple[tuple[str, float, float], ...]


@dataclass(frozen=True)
class _Task:
    """An object, its prompt and the photo of the prompt (None for a text), and the photos it is evaluated in."""

    object: str
    kind: PromptKind
    prompt_photo: str | None
    photos: tuple[str, ...]


class _Scores(NamedTuple):
    """Scores of one view, or their means over the views."""

    iou: float
    boundary_iou: float
    halo: float
    stray: float
    holes: float
    psnr: float


_NOTHING_FOUND = _Scores(0.0, 0.0, np.nan, np.nan, 1.0, np.nan)


@dataclass(frozen=True)
class _Answer:
    """Objects that a prompt returned, the best first, bool [N] each; or the reason why there are none."""

    finds: tuple[Mask, ...]
    seconds: float
    cpu_seconds: float
    remark: str


@dataclass
class _Result:
    """The Gaussians that one method returned for one object, bool [N] or None, and their scores in each view."""

    task: _Task
    method: Method
    answer: _Answer
    members: Mask | None
    scores: list[_Scores]


def evaluate_project(
    project: ProjectFolder,
    truth_folder: Path,
    settings: EvaluationSettings,
    *,
    layout: Layout | Literal["auto"] = "auto",
    detector_factory: DetectorFactory,
    sam_factory: SamFactory,
    emit: Emit,
    should_stop: StopCheck,
) -> Evaluation:
    """Isolate every object with every method and compare it with its true masks.

    Parameters
    ----------
    project : ProjectFolder
        Trained; only read.
    truth_folder : Path
    settings : EvaluationSettings
    layout : str
        See `read_ground_truth`.
    detector_factory, sam_factory : callable
        Called only when their model is needed.
    emit, should_stop
        See `engine.events`.

    Returns
    -------
    Evaluation

    Raises
    ------
    HeritageError
        When a part of the project, or the true masks, are missing or damaged.
    Cancelled
        When `should_stop` says so.

    Notes
    -----
    With ``views="held-out"``, SAM's segments of the evaluated photos neither vote nor are searched for a text. Only the
    crops by which results of a text are scored come from evaluated photos. Predicted masks are those of
    `render --what mask`.
    """
    cameras = read_camera_set(project.path / "cameras")
    gaussians = load_gaussians(project.path / "gaussians")
    placed = [camera.photo for camera in cameras.cameras]
    truth = read_ground_truth(truth_folder, placed, cameras.unregistered, layout=layout)
    if truth.unplaced:
        emit(Warned(f"{len(truth.unplaced)} views with true masks have no camera here: {', '.join(truth.unplaced)}."))
    held_out = _held_out(project)
    photos = _evaluated(truth, held_out, settings)
    wanted = _wanted(truth, settings)
    tasks = _tasks(truth, wanted, photos, settings)
    label_maps = label_maps_of(project.path, cameras)
    if settings.views == "held-out":
        label_maps = {photo: labels for photo, labels in label_maps.items() if photo not in photos}
    answers: dict[tuple[str, str], _Answer] = {}
    asked: list[tuple[_Task, Method, _Answer]] = []
    methods = methods_of(settings)
    with tempfile.TemporaryDirectory() as kept:
        scene = _TrainedScene(
            gaussians, cameras, photo_folder_of(project), label_maps, Path(kept), detector_factory, sam_factory
        )
        for number, (task, method) in enumerate((task, method) for task in tasks for method in methods):
            if should_stop():
                raise Cancelled("Stopped while isolating; nothing was written.")
            share = _ISOLATION_SHARE * number / (len(tasks) * len(methods))
            emit(Progress(STAGE, share, message=f"{task.object}: {method.name}"))
            # Equal objects share one text, which is asked for once.
            key = (truth.prompts[task.object] if task.prompt_photo is None else task.object, method.name)
            if key not in answers:
                answers[key] = scene.isolate(task, method, truth, should_stop)
            asked.append((task, method, answers[key]))
    labels = gaussian_truth(Scene(gaussians), cameras, truth, should_stop) if truth.every_pixel else None
    results = [_Result(task, method, answer, _own(task, answer, truth, labels), []) for task, method, answer in asked]
    _score(scene, results, truth, photos, emit, should_stop)
    return Evaluation(
        rows=tuple(_row(result, truth, labels) for result in results),
        settings=settings,
        layout=truth.layout,
        photos=photos,
        n_trained_on=len(set(photos) - set(held_out)),
        unplaced=truth.unplaced,
        left_out=tuple(name for name in wanted if name not in {task.object for task in tasks}),
        n_gaussians=len(gaussians),
        stages=_stages(project),
    )


def _stages(project: ProjectFolder) -> tuple[tuple[str, float, float], ...]:
    records = ((stage, project.stage_record(stage)) for stage in ("photos", "cameras", "masks", "training"))
    return tuple((stage, done["wall_seconds"], done["cpu_seconds"]) for stage, done in records if done)


def _own(task: _Task, answer: _Answer, truth: GroundTruth, labels: NDArray[np.int32] | None) -> Mask | None:
    """Return the result that counts for an object: the first, unless equal objects share one text.

    Then as many results as there are objects count. They are assigned to the objects so that the sum of the IoU of the
    Gaussians is largest.
    """
    prompt = truth.prompts[task.object]
    equal = [name for name in truth.objects if truth.prompts[name] == prompt]
    if task.prompt_photo is not None or labels is None or len(equal) == 1:
        return answer.finds[0] if answer.finds else None
    finds = answer.finds[: len(equal)]
    likeness = np.array(
        [[gaussian_iou(find, labels, truth.objects.index(name)) for find in finds] for name in equal]
    ).reshape(len(equal), len(finds))
    given = dict(zip(*linear_sum_assignment(likeness, maximize=True), strict=True))
    number = given.get(equal.index(task.object))
    return None if number is None else finds[number]


def visible_masks(scene: Scene, camera: Camera, members: Sequence[Mask]) -> Iterator[Mask]:
    """Yield for each set of Gaussians where it makes up more than half of a pixel of the photo, bool [height, width].

    The same as `engine.pictures.render_view` with ``what="mask"``, for several sets in one pass.
    """
    frame = covering_pinhole(camera)
    for start in range(0, len(members), _MAX_OBJECTS_PER_PASS):
        weights = np.stack(members[start : start + _MAX_OBJECTS_PER_PASS], axis=1).astype(np.float32)
        shares = scene.render(frame, channels=weights).channels
        for channel in range(shares.shape[2]):
            yield np.asarray(distort(np.ascontiguousarray(shares[..., channel]), frame, camera) > 0.5)


class _TrainedScene:
    """A trained scene with everything that isolating and comparing need."""

    def __init__(
        self,
        gaussians: Gaussians,
        cameras: CameraSet,
        photo_folder: Path,
        label_maps: Mapping[str, NDArray[np.int32]],
        kept: Path,
        detector_factory: DetectorFactory,
        sam_factory: SamFactory,
    ) -> None:
        self.gaussians, self.cameras, self.photo_folder = gaussians, cameras, photo_folder
        # The appearance of the groups is computed once, as in a project; the project itself is only read here.
        self._appearance_file = kept / "looks.npz"
        self.camera_of = {camera.photo: camera for camera in cameras.cameras}
        self._label_maps = label_maps
        self._detector_factory, self._sam_factory = detector_factory, sam_factory

    def isolate(self, task: _Task, method: Method, truth: GroundTruth, should_stop: StopCheck) -> _Answer:
        """Return the answer of a method to the prompt for an object."""
        found, remark = [], ""
        with tempfile.TemporaryDirectory() as folder:
            prompt = self._prompt(task, truth, Path(folder))
            started, started_cpu = time.perf_counter(), time.process_time()
            try:
                found = find_objects(
                    self._context(method),
                    prompt,
                    method.settings,
                    detector_factory=self._detector_factory,
                    emit=ignore_events,
                    should_stop=should_stop,
                )
            except PromptError as error:
                remark = str(error)
            seconds, cpu_seconds = time.perf_counter() - started, time.process_time() - started_cpu
        return _Answer(tuple(one.membership >= THRESHOLD for one in found), seconds, cpu_seconds, remark)

    def _context(self, method: Method) -> SegmentationContext:
        settings = method.settings
        return SegmentationContext(
            Views(Scene(self.gaussians), self.cameras, render_side=settings.render_side),
            Photos(self.photo_folder, settings.photo_side, self._sam_factory),
            self._label_maps if method.snaps else {},
            self._appearance_file,
        )

    def _prompt(self, task: _Task, truth: GroundTruth, folder: Path) -> Prompt:
        if task.prompt_photo is None:
            return TextPrompt(truth.prompts[task.object])
        camera = self.camera_of[task.prompt_photo]
        mask = _resized(truth.masks(task.prompt_photo)[task.object], (camera.height, camera.width), task.prompt_photo)
        if task.kind == "click":
            y, x = innermost_pixel(mask)
            return ClickPrompt(task.prompt_photo, x, y)
        file = folder / "mask.png"
        write_png(file, np.where(mask, np.uint8(255), np.uint8(0)))
        return MaskPrompt(task.prompt_photo, file)


def _held_out(project: ProjectFolder) -> tuple[str, ...]:
    figures = (project.stage_record("training") or {}).get("figures", {})
    return tuple(figures.get("held_out") or ())


def _evaluated(truth: GroundTruth, held_out: Sequence[str], settings: EvaluationSettings) -> tuple[str, ...]:
    photos = truth.photos if settings.views == "all" else tuple(name for name in truth.photos if name in held_out)
    if not photos:
        raise SettingsError(
            f"Training saw all of the {len(truth.photos)} photos with true masks. Compare those with --views all; the "
            "table then states that."
        )
    return photos


def _wanted(truth: GroundTruth, settings: EvaluationSettings) -> tuple[str, ...]:
    unknown = [name for name in settings.objects if name not in truth.objects]
    if unknown:
        raise SettingsError(f"There are no true masks of {unknown[0]!r}, only of: {', '.join(truth.objects)}.")
    return tuple(name for name in truth.objects if not settings.objects or name in settings.objects)


def _tasks(
    truth: GroundTruth, wanted: Sequence[str], photos: Sequence[str], settings: EvaluationSettings
) -> list[_Task]:
    """Return the objects to ask for, without those that no photo is left to evaluate in."""
    shown: dict[str, dict[str, tuple[bool, float]]] = {name: {} for name in wanted}
    for photo in truth.photos:
        for name, mask in truth.masks(photo).items():
            if name in shown:
                cut = bool(mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any())
                shown[name][photo] = (not cut, float(mask.mean()))
    tasks = []
    for name, sizes in shown.items():
        looked_at = [photo for photo in photos if photo in sizes]
        prompt_photo = None
        if settings.prompt_kind != "text" and sizes:
            # Photos that show the object whole come first, then the largest. If all are evaluated, one is given up.
            spare = [photo for photo in sizes if photo not in looked_at]
            prompt_photo = max(spare or sizes, key=lambda photo: sizes[photo])
        others = tuple(photo for photo in looked_at if photo != prompt_photo)
        if others:
            tasks.append(_Task(name, settings.prompt_kind, prompt_photo, others))
    if not tasks:
        raise SettingsError(
            f"None of {', '.join(wanted)} is in two photos: there is nothing to compare. Use --views all."
        )
    return tasks


def _score(
    scene: _TrainedScene,
    results: Sequence[_Result],
    truth: GroundTruth,
    photos: Sequence[str],
    emit: Emit,
    should_stop: StopCheck,
) -> None:
    """Add the scores of every photo to the results that are evaluated in it."""
    whole = Scene(scene.gaussians)
    for number, photo in enumerate(photos):
        if should_stop():
            raise Cancelled("Stopped while comparing; nothing was written.")
        share = _ISOLATION_SHARE + (1 - _ISOLATION_SHARE) * number / len(photos)
        emit(Progress(STAGE, share, message=f"Comparing with {photo}"))
        camera, masks = scene.camera_of[photo], truth.masks(photo)
        looked_at = [result for result in results if photo in result.task.photos]
        found = [result.members for result in looked_at if result.members is not None]
        shown = visible_masks(whole, camera, found)
        pixels = load_pixels(scene.photo_folder / photo) if found else None
        for result in looked_at:
            if result.members is None:
                result.scores.append(_NOTHING_FOUND)
                continue
            assert pixels is not None
            mask = masks[result.task.object]
            inside = _resized(mask, (camera.height, camera.width), photo)
            predicted = _resized(next(shown), mask.shape, photo)
            alone = render_view(scene.gaussians, camera, what="rgb", members=result.members)
            result.scores.append(
                _Scores(
                    iou(predicted, mask),
                    boundary_iou(predicted, mask),
                    halo(predicted, mask),
                    stray(predicted, mask),
                    holes(predicted, mask),
                    psnr(alone, pixels, mask=inside) if inside.any() else np.nan,
                )
            )


def _resized(mask: Mask, shape: tuple[int, ...], photo: str) -> Mask:
    """Return a mask of the whole photo at another resolution.

    Raises
    ------
    MaskError
        When its aspect ratio differs, so that it cannot belong to this photo.
    """
    if mask.shape == shape:
        return mask
    (height, width), (new_height, new_width) = mask.shape, shape
    if abs(width / height * new_height / new_width - 1) > _MAX_ASPECT_DEVIATION:
        raise MaskError(
            f"The true masks of {photo} have another aspect ratio: {width} x {height} pixels and "
            f"{new_width} x {new_height}."
        )
    return np.asarray(cv2.resize(mask.astype(np.uint8), (new_width, new_height), interpolation=cv2.INTER_NEAREST) > 0)


def _row(result: _Result, truth: GroundTruth, labels: NDArray[np.int32] | None) -> Row:
    means = _Scores(*(mean_of(values) for values in zip(*result.scores, strict=True)))
    index = truth.objects.index(result.task.object)
    return Row(
        object=result.task.object,
        method=result.method.name,
        found=result.members is not None,
        **means._asdict(),
        gaussian_iou=float("nan") if labels is None else gaussian_iou(result.members, labels, index),
        seconds=result.answer.seconds,
        cpu_seconds=result.answer.cpu_seconds,
        n_views=len(result.scores),
        prompt_photo=result.task.prompt_photo or "",
        remark=result.answer.remark
        or ("" if result.members is not None else "Fewer objects were found than there are."),
    )


def mean_of(values: Sequence[float]) -> float:
    """Return the mean of the values that are not NaN; NaN when there are none."""
    numbers = [value for value in values if not np.isnan(value)]
    return float(np.mean(numbers)) if numbers else float("nan")
