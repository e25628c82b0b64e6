"""The pipeline from a photo folder to a finished project: the stages in order, read from top to bottom."""

from __future__ import annotations

import contextlib
import functools
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from .. import __version__
from ..cameras.settings import CameraSettings
from ..core.errors import ProjectError
from ..core.events import Emit, StageStarted, StopCheck
from ..masks import MasksBeside
from ..masks.settings import MaskSettings
from ..objects.settings import SegmentSettings
from ..photos import extract_frames, is_video
from ..photos.settings import PhotoSettings, VideoSettings
from ..project.folder import ProjectFolder
from ..rasterizer import Device, choose_training_device
from ..scene import PhotoSet
from .planning import (
    PlanSettings,
    WorkPlan,
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
from .stages import (
    STAGES,
    StageRunner,
    TrainingInput,
    cameras_stage,
    masks_stage,
    objects_stage,
    photos_stage,
    report_stage,
    training_stage,
)

__all__ = ["PipelineSettings", "reconstruct"]


@dataclass(frozen=True)
class PipelineSettings:
    """Settings of every package, gathered for one run.

    Attributes
    ----------
    photos, cameras, masks, plan, segment
        The packages' own settings; `plan.preset` names the training preset.
    camera_model : Path or None
        Cameras of another program to read instead of estimating them, see `engine.cameras.read_cameras`.
    photo_masks : Path or None
        Folder of masks that say which pixels of the photos count, see `photos.photo_masks`.
    mask_background : bool
        Make such masks, which leave out the background, with Segment Anything.
    prompts : tuple of str
        Objects to isolate at the end, as text.
    """

    photos: PhotoSettings = field(default_factory=PhotoSettings)
    cameras: CameraSettings = field(default_factory=CameraSettings)
    masks: MaskSettings = field(default_factory=MaskSettings)
    plan: PlanSettings = field(default_factory=PlanSettings)
    segment: SegmentSettings = field(default_factory=SegmentSettings)
    camera_model: Path | None = None
    photo_masks: Path | None = None
    mask_background: bool = False
    prompts: tuple[str, ...] = ()


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
    settings : PipelineSettings
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
    HeritageError
        One of its subclasses, with a sentence for the user. What was done until then is kept.
    """
    if out.resolve() == photos.resolve():
        raise ProjectError(f"{out} is the photo folder itself. Choose another folder for the project.")
    given_photos = photos
    with ProjectFolder.create(out) as project, contextlib.ExitStack() as running:
        runner = StageRunner(project, emit, should_stop)
        if is_video(photos):
            frames = project.path / "frames"
            emit(StageStarted("frames"))
            extract_frames(photos, frames, VideoSettings(), emit=emit, should_stop=should_stop)
            photos = frames
        criteria = settings.photos.for_lens(settings.cameras.model, is_given=settings.camera_model is not None)
        photo_set, statistics = photos_stage(
            runner, photos, criteria, photo_masks=settings.photo_masks,
            background_sam=settings.masks.model if settings.mask_background else None,
        )  # fmt: skip
        project.put("photo_folder", str(photos.resolve()))
        project.put("engine_version", __version__)
        store_input(project, _input_of(given_photos, settings))
        preset, wanted = settings.plan.preset, STAGES[: STAGES.index(until) + 1]
        # A finished training and the stages before it need no card, whose test takes seconds.
        looks_for_card = "training" in wanted and training_is_to_come(
            project, preset, photos_changed="photos" in runner.computed
        )
        work, forecast, calibration = plan_and_forecast(
            photo_set,
            statistics,
            settings.plan,
            cameras=settings.cameras,
            model=settings.camera_model,
            n_prompts=len(settings.prompts),
            device=choose_training_device(settings.plan.device) if looks_for_card else planned_device(project, preset),
            kept=kept_sizes(project, preset),
            emit=emit,
        )
        needed = tuple(stage for stage in forecast.stages if stage.stage in wanted)
        require_enough_memory(replace(forecast, stages=needed), work, calibration)
        store_forecast(project, work, forecast)
        if until == "photos":
            return project
        training = training_settings(work)
        try:
            # Those of an earlier run are kept until the masks stage replaces them.
            may_start = forecast.masks_beside and "masks" in wanted and runner.key_of("masks") is None
            beside = running.enter_context(_masks_beside(project, photo_set, work, settings)) if may_start else None
            camera_set = cameras_stage(
                runner, photo_set, settings.cameras, camera_model=settings.camera_model, masks_beside=beside
            )
            plan = plan_scene(work, camera_set)
            project.put("plan", asdict(plan))
            if until == "cameras":
                return project
            label_maps = masks_stage(runner, photo_set, plan, settings.masks, beside=beside)
            if until == "masks":
                return project
            cameras_key = runner.key_of("cameras")
            masks_key = runner.key_of("masks") if label_maps else cameras_key
            given = TrainingInput(photo_set, camera_set, label_maps, cameras_key, masks_key)

            @functools.cache
            def find_device() -> Device:
                """Return the planned device; one is looked for now if the plan took a training for done that is not."""
                planned = Device(work.device.backend, work.device.name, work.device.reason)
                return planned if looks_for_card else choose_training_device(settings.plan.device)

            record_sizes(project, preset, work.sizes)
            training_stage(runner, given, plan, training, preset=preset, find_device=find_device)
            if until == "training":
                return project

            def rendering_device() -> Device:
                return replace(find_device(), required=settings.plan.device == "gpu")

            objects_stage(
                runner, settings.prompts, settings.segment,
                sam_model=settings.masks.model, find_device=rendering_device,
            )  # fmt: skip
            if until == "objects":
                return project
            report_stage(runner, find_device=rendering_device)
        finally:
            # The finished stages inform the next forecast, also when the others were stopped.
            update_calibration(project, runner.computed, work, forecast, calibration)
        return project


def _input_of(photos: Path, settings: PipelineSettings) -> ReconstructionInput:
    def absolute(path: Path | None) -> str | None:
        return None if path is None else str(path.resolve())

    return ReconstructionInput(
        str(photos.resolve()),
        absolute(settings.camera_model),
        absolute(settings.photo_masks),
        settings.mask_background,
        settings.plan.exclude_transients,
        settings.plan.wants_objects,
    )


def _masks_beside(
    project: ProjectFolder, photo_set: PhotoSet, work: WorkPlan, settings: PipelineSettings
) -> MasksBeside:
    """Return what makes masks of the photos that the plan will name if all of them get a camera."""
    names = sorted(photo.name for photo in photo_set.photos)
    return MasksBeside(
        project.path / "photos" / "photos.json",
        photo_set.folder,
        choose_photos(work, names)[1],
        project.path / "masks",
        settings.masks,
    )
