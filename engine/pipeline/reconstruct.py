"""The pipeline from a photo folder to a finished project: the stages in order, read from top to bottom."""

from __future__ import annotations

import contextlib
import functools
import importlib
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from .. import __version__
from ..cameras.settings import CameraSettings
from ..core.errors import ProjectError
from ..core.events import Emit, StageStarted, StopCheck
from ..core.parts import part
from ..masks import MasksBeside
from ..masks.settings import MaskSettings
from ..objects.settings import SegmentSettings
from ..photos import extract_frames, is_video
from ..photos.settings import PhotoSettings, VideoSettings
from ..project.folder import ProjectFolder
from ..rasterizer import Device, choose_device
from ..scene import PhotoSet
from ..training.settings import LIGHT_SHARE
from .first_picture import MIN_PHOTOS, FirstPicture
from .objects_stage import objects_stage
from .planning import (
    PlannedWork,
    PlanSettings,
    choose_photos,
    kept_sizes,
    plan_and_forecast,
    plan_scene,
    planned_device,
    record_sizes,
    require_enough_memory,
    store_forecast,
    training_is_to_come,
    training_settings,
    update_calibration,
)
from .reconstruction_input import ReconstructionInput, store_input
from .runner import StageRunner
from .stages import STAGES, TrainingInput, cameras_stage, masks_stage, photos_stage, report_stage, training_stage


@dataclass(frozen=True)
class PipelineSettings:
    """Settings of every package, gathered for one run.

    Attributes
    ----------
    photos, cameras, masks, plan, segment
        The packages' own settings; `plan.preset` names the training preset.
    given_cameras : Path or None
        Cameras of another program to read instead of estimating them, see `engine.cameras.read_cameras`.
    photo_masks : Path or None
        Folder of masks that say which pixels of the photos count, see `photos.photo_masks`.
    mask_background : bool
        Make such masks, which leave out the background, with Segment Anything.
    prompts : tuple of str
        Objects to isolate at the end, as text.
    is_followed : bool
        Whether someone sees the previews of the run, who gets a first picture while the cameras are estimated.
    """

    photos: PhotoSettings = field(default_factory=PhotoSettings)
    cameras: CameraSettings = field(default_factory=CameraSettings)
    masks: MaskSettings = field(default_factory=MaskSettings)
    plan: PlanSettings = field(default_factory=PlanSettings)
    segment: SegmentSettings = field(default_factory=SegmentSettings)
    given_cameras: Path | None = None
    photo_masks: Path | None = None
    mask_background: bool = False
    prompts: tuple[str, ...] = ()
    is_followed: bool = False


def reconstruct(
    photos: Path,
    out: Path,
    settings: PipelineSettings,
    *,
    emit: Emit,
    should_stop: StopCheck,
    until: str = "report",
) -> ProjectFolder:
    """Turn a folder of photos into a project: cameras, masks, Gaussians, objects and a report.

    Parameters
    ----------
    photos : Path
        Folder with the photos, or a video.
    out : Path
        Project folder, new or of an earlier run that is continued.
    emit, should_stop
        See `engine.core.events`.
    until : str
        The last stage to do, one of `STAGES`; by default the report, which is the last of all. Memory is demanded only
        for the stages up to it.

    Returns
    -------
    ProjectFolder
        With every stage up to `until` done.

    Raises
    ------
    ProjectError
        When `out` is the folder of the photos, or no project folder.
    HeritageError
        Another of its subclasses, with a sentence for the user. What was done until then is kept.
    """
    if out.resolve() == photos.resolve():
        raise ProjectError(f"{out} is the photo folder itself. Choose another folder for the project.")
    with ProjectFolder.create(out) as project, contextlib.ExitStack() as running:
        _Run(StageRunner(project, emit, should_stop), photos, settings, running).run(until)
        return project


class _Run:
    """One run of the pipeline: a method for each of `STAGES`, which keeps what the later ones need."""

    def __init__(
        self, runner: StageRunner, photos: Path, settings: PipelineSettings, running: contextlib.ExitStack
    ) -> None:
        self._runner, self._project = runner, runner.project
        self._photos, self._settings, self._running = photos, settings, running
        self._preset = settings.plan.preset

    def run(self, until: str) -> None:
        """Do the stages up to `until`."""
        wanted = STAGES[: STAGES.index(until) + 1]
        with part("photos"):
            self.photos()
        with part("planning"):
            self._plan(wanted)
        if until == STAGES[0]:
            return
        later = {
            "cameras": self.cameras, "masks": self.masks, "training": self.training,
            "objects": self.objects, "report": self.report,
        }  # fmt: skip
        try:
            for name in wanted[1:]:
                with part(name):
                    later[name]()
        finally:
            # The finished stages inform the next forecast, also when the others were stopped.
            update_calibration(self._project, self._runner.computed, *self._planned)

    def photos(self) -> None:
        """Read the photos, which are frames if a video was given."""
        folder, settings, runner = self._photos, self._settings, self._runner
        if is_video(folder):
            folder = self._project.path / "frames"
            runner.emit(StageStarted("frames"))
            extract_frames(self._photos, folder, VideoSettings(), emit=runner.emit, should_stop=runner.should_stop)
        criteria = settings.photos.for_lens(settings.cameras.model, is_given=settings.given_cameras is not None)
        self._photo_set, self._statistics = photos_stage(
            runner, folder, criteria, photo_masks=settings.photo_masks,
            background_sam=settings.masks.model if settings.mask_background else None,
        )  # fmt: skip
        self._project.put("photo_folder", str(folder.resolve()))
        self._project.put("engine_version", __version__)
        store_input(self._project, _input_of(self._photos, settings))

    def _plan(self, wanted: Sequence[str]) -> None:
        """Decide what the stages do and on which device, and refuse them if memory does not suffice."""
        settings, project, preset = self._settings, self._project, self._preset
        # A finished training and the stages before it need no card, whose test takes seconds.
        self._looked_for_card = "training" in wanted and training_is_to_come(
            project, preset, photos_changed="photos" in self._runner.computed
        )
        device = self._card_and_torch() if self._looked_for_card else planned_device(project, preset)
        self._planned = plan_and_forecast(
            self._photo_set,
            self._statistics,
            settings.plan,
            cameras=settings.cameras,
            given_cameras=settings.given_cameras,
            n_prompts=len(settings.prompts),
            device=device,
            kept=kept_sizes(project, preset),
            emit=self._runner.emit,
        )
        work, forecast, calibration = self._planned
        needed = tuple(stage for stage in forecast.stages if stage.stage in wanted)
        require_enough_memory(replace(forecast, stages=needed), work, calibration)
        store_forecast(project, work, forecast)
        # Masks of an earlier run are kept until the masks stage replaces them.
        makes_masks = "masks" in wanted and self._runner.key_of("masks") is None
        self._may_start_masks = forecast.masks_beside > 0 and makes_masks
        self._may_start_picture = settings.is_followed and forecast.picture_beside and "training" in wanted

    def _card_and_torch(self) -> Device:
        """Return the device, and import torch at the same time, since a process of its own looks for cards.

        If torch is missing, that is said now, not after the cameras were estimated.
        """
        with ThreadPoolExecutor(1) as beside:
            found = beside.submit(self._find_device)
            with part("imports"):
                importlib.import_module("torch")
            with part("self-test of the card"):
                return found.result()

    def _find_device(self) -> Device:
        return choose_device(self._settings.plan.device)

    @functools.cached_property
    def _device(self) -> Device:
        """The planned device; one is looked for now if the plan took a training for done that is not."""
        device = self._planned.work.device if self._looked_for_card else self._find_device()
        return replace(device, required=self._settings.plan.device == "gpu")

    def cameras(self) -> None:
        """Estimate or read the cameras, and name the photos that get masks."""
        work = self._planned.work
        self._beside: MasksBeside | None = None
        self._first_picture: FirstPicture | None = None
        if self._may_start_masks:
            self._beside = self._running.enter_context(
                _masks_beside(self._project, self._photo_set, self._planned, self._settings)
            )
        if self._may_start_picture and len(self._photo_set.photos) >= MIN_PHOTOS:
            lens, emit = self._settings.cameras.model, self._runner.emit
            picture = FirstPicture(self._project.path, self._photo_set, lens, emit)
            self._first_picture = self._running.enter_context(picture)
            self._runner = replace(self._runner, should_stop=picture.watched_by(self._runner.should_stop))
        self._camera_set = cameras_stage(
            self._runner, self._photo_set, self._settings.cameras, given_cameras=self._settings.given_cameras,
            beside=[one for one in (self._first_picture, self._beside) if one is not None],
        )  # fmt: skip
        self._scene_plan = plan_scene(work, self._camera_set)
        self._project.put("plan", asdict(self._scene_plan))

    def masks(self) -> None:
        """Segment the photos that the plan names."""
        self._label_maps = masks_stage(
            self._runner, self._photo_set, self._scene_plan, self._settings.masks, beside=self._beside
        )

    def training(self) -> None:
        """Train the Gaussians."""
        if self._first_picture is not None:
            self._first_picture.end()
        work, cameras_key = self._planned.work, self._runner.key_of("cameras")
        masks_key = self._runner.key_of("masks") if self._label_maps else cameras_key
        given = TrainingInput(self._photo_set, self._camera_set, self._label_maps, cameras_key, masks_key)
        record_sizes(self._project, self._preset, work.sizes)
        training_stage(
            self._runner, given, self._scene_plan, training_settings(work), preset=self._preset,
            find_device=lambda: self._device,
        )  # fmt: skip

    def objects(self) -> None:
        """Isolate the objects that the prompts name."""
        objects_stage(
            self._runner, self._settings.prompts, self._settings.segment,
            sam_model=self._settings.masks.model, find_device=lambda: self._device,
        )  # fmt: skip

    def report(self) -> None:
        """Write the report."""
        report_stage(self._runner, find_device=lambda: self._device)


def _input_of(photos: Path, settings: PipelineSettings) -> ReconstructionInput:
    def absolute(path: Path | None) -> str | None:
        return None if path is None else str(path.resolve())

    return ReconstructionInput(
        str(photos.resolve()),
        absolute(settings.given_cameras),
        absolute(settings.photo_masks),
        settings.mask_background,
        settings.plan.exclude_transients,
        settings.plan.wants_objects,
        settings.plan.overrides.get("kept") == LIGHT_SHARE,
    )


def _masks_beside(
    project: ProjectFolder, photo_set: PhotoSet, planned: PlannedWork, settings: PipelineSettings
) -> MasksBeside:
    """Return what makes masks of the photos that the plan will name if all of them get a camera."""
    names = sorted(photo.name for photo in photo_set.photos)
    return MasksBeside(
        project.path / "photos" / "photos.json",
        photo_set.folder,
        choose_photos(planned.work, names)[1],
        project.path / "masks",
        settings.masks,
        n_processes=planned.forecast.masks_beside,
    )
