"""Photos, cameras and label maps, made once and trained on by every preset of a comparison."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ...core.errors import ProjectError
from ...core.events import Emit, StopCheck
from ...masks import label_map_path
from ...photos import PhotoStatistics, inspect_photos
from ...pipeline.planning import WorkPlan, plan_scene, record_sizes
from ...pipeline.reconstruct import PipelineSettings
from ...pipeline.runner import StageRunner
from ...pipeline.stages import TrainingInput, cameras_stage, masks_stage, photos_stage, training_stage
from ...project.folder import ProjectFolder
from ...scene import read_camera_set, read_photo_set
from ...training.settings import TrainingSettings


@dataclass(frozen=True)
class PreparedScene(TrainingInput):
    """Input of training, with the statistics that plans are made from.

    Attributes
    ----------
    statistics : sequence of PhotoStatistics
    """

    statistics: Sequence[PhotoStatistics]


def prepare(
    photos: Path, out: Path, settings: PipelineSettings, *, emit: Emit, should_stop: StopCheck
) -> PreparedScene:
    """Read the photos and estimate the cameras in the project `out`; parameters and errors as of `reconstruct`."""
    with ProjectFolder.create(out) as project:
        runner = StageRunner(project, emit, should_stop)
        photo_set, statistics = photos_stage(runner, photos, settings.photos, photo_masks=settings.photo_masks)
        project.put("photo_folder", str(photos.resolve()))
        camera_set = cameras_stage(runner, photo_set, settings.cameras, given_cameras=settings.given_cameras)
        key = runner.key_of("cameras")
        return PreparedScene(photo_set, camera_set, {}, key, key, statistics)


def read_prepared(scene: Path, should_stop: StopCheck) -> PreparedScene:
    """Return the photos, cameras and label maps of a finished project, which is only read.

    Raises
    ------
    ProjectError
        When the project has no cameras, or its photos are missing.
    """
    project = ProjectFolder.open_existing(scene)
    project.require_intact("photos", "cameras", "masks")
    record = project.stage_record("cameras")
    if record is None:
        raise ProjectError(f"{scene} has no cameras yet. Run reconstruct on its photos first, or name the photos.")
    folder = Path(str(project.get("photo_folder")))
    if not folder.is_dir():
        raise ProjectError(f"The photos of {scene} are no longer in {folder}. Put them back.")
    photo_set = replace(read_photo_set(scene / "photos" / "photos.json"), folder=folder)
    camera_set = read_camera_set(scene / "cameras")
    paths = {camera.photo: label_map_path(scene / "masks", camera.photo) for camera in camera_set.cameras}
    label_maps = {name: path for name, path in paths.items() if path.is_file()}
    of_masks = project.stage_record("masks") if label_maps else record
    return PreparedScene(
        photo_set,
        camera_set,
        label_maps,
        record["key"],
        (of_masks or record)["key"],
        inspect_photos(photo_set, should_stop=should_stop),
    )


def prepare_masks(
    prepared: PreparedScene,
    out: Path,
    work: WorkPlan,
    settings: PipelineSettings,
    *,
    emit: Emit,
    should_stop: StopCheck,
) -> tuple[PreparedScene, ProjectFolder]:
    """Make the label maps that a plan asks for in the project folder `out`, which then holds the stage's record."""
    with ProjectFolder.create(out) as project:
        runner = StageRunner(project, emit, should_stop)
        plan = plan_scene(work, prepared.camera_set)
        label_maps = masks_stage(runner, prepared.photo_set, plan, settings.masks)
        masks_key = runner.key_of("masks") if label_maps else prepared.cameras_key
        return replace(prepared, label_maps=label_maps, masks_key=masks_key), project


def train_prepared(
    prepared: PreparedScene,
    out: Path,
    work: WorkPlan,
    training: TrainingSettings,
    *,
    emit: Emit,
    should_stop: StopCheck,
) -> ProjectFolder:
    """Train in a project folder of its own, from cameras and label maps of another; resumes like `reconstruct`."""
    with ProjectFolder.create(out) as project:
        runner = StageRunner(project, emit, should_stop)
        plan = plan_scene(work, prepared.camera_set)
        label_maps = {name: path for name, path in prepared.label_maps.items() if name in plan.mask_photos}
        given = replace(prepared, label_maps=label_maps)
        record_sizes(project, work.preset, work.sizes)
        training_stage(runner, given, plan, training, preset=work.preset, find_device=lambda: work.device)
        return project
