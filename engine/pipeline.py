"""The corridor: the stages in order, read top to bottom. A stage whose inputs did not change is not run again."""

from __future__ import annotations

import functools
import shutil
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from . import __version__
from .cameras.settings import CameraSettings
from .errors import Cancelled, ProjectError
from .events import Emit, StageFinished, StageStarted, StopCheck, Warned, part_of
from .machine import PeakMemory, cpu_seconds
from .masks.settings import MaskSettings
from .objects.settings import SegmentSettings
from .photos import PhotoLook
from .photos.settings import PhotoSettings
from .planning import (
    PlanSettings,
    ScenePlan,
    WorkPlan,
    learn_from,
    plan_and_forecast,
    plan_scene,
    require_fit,
    store_forecast,
    training_settings,
)
from .project_folder import ProjectFolder, file_sha256, stage_key, write_json
from .scene import CameraSet, PhotoSet
from .settings import to_dict
from .training.settings import TrainingSettings

__all__ = ["STAGES", "PipelineSettings", "Prepared", "prepare", "prepare_masks", "reconstruct", "train_prepared"]

_PROMPTED = "objects_by_prompt"
_BEGUN = "begun"
STAGES = ("photos", "cameras", "masks", "training", "objects", "report")


@dataclass(frozen=True)
class PipelineSettings:
    """Settings of every room, gathered for one run.

    Attributes
    ----------
    photos, cameras, masks, plan, segment
        The rooms' own settings; `plan.preset` names the training preset.
    camera_model : Path or None
        An existing COLMAP model folder or ``transforms.json`` to read instead of estimating the cameras.
    photo_masks : Path or None
        Folder of masks that say which pixels of the photos count, see `photos.photo_masks`.
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
    prompts: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Run:
    """One run of the corridor: where it writes and whom it tells."""

    project: ProjectFolder
    emit: Emit
    should_stop: StopCheck
    computed: list[str] = field(default_factory=list)

    def stage(self, name: str, key: str, work: Callable[[], dict[str, Any]], leaves: Iterable[Path] = ()) -> None:
        """Run `work` unless the stage is done with this `key` and what it `leaves` is there; store figures and cost."""
        if self.should_stop():
            raise Cancelled(f"Stopped before the stage {name!r}. Run the same command again to continue.")
        self.emit(StageStarted(name))
        wall, cpu = time.perf_counter(), cpu_seconds()
        reused = self.project.stage_is_done(name, key) and all(path.is_file() for path in leaves)
        if not reused:
            continued = self.project.get(_BEGUN) == [name, key]
            # Reading photos keeps nothing half-done, and may end with a refusal that must change nothing here.
            if name != "photos":
                self.project.put(_BEGUN, [name, key])
            with PeakMemory.of() as peak:
                figures = work()
            self.project.finish_stage(
                name,
                key,
                wall_seconds=time.perf_counter() - wall,
                cpu_seconds=cpu_seconds() - cpu,
                figures=figures,
                peak_memory=peak.bytes,
                continued=continued,
            )
            self.computed.append(name)
        self.emit(StageFinished(name, time.perf_counter() - wall, reused))

    def replace(self, name: str) -> None:
        """Say that the files of a stage are about to become those of this run: a kill must not leave them as done."""
        self.project.forget_stages([name])


def reconstruct(
    photos: Path, out: Path, settings: PipelineSettings, *, emit: Emit, should_stop: StopCheck
) -> ProjectFolder:
    """Turn a folder of photos into a project: cameras, masks, Gaussians, objects and a report.

    Parameters
    ----------
    photos : Path
        Folder with the photos.
    out : Path
        Project folder, new or of an earlier run that is continued.
    settings : PipelineSettings
    emit, should_stop
        See `engine.events`.

    Returns
    -------
    ProjectFolder
        With every stage done.

    Raises
    ------
    HeritageError
        One of its kinds, with a sentence for the person. What was done until then is kept.
    """
    if out.resolve() == photos.resolve():
        raise ProjectError(f"{out} is the photo folder itself. Choose another folder for the project.")
    with ProjectFolder.create(out) as project:
        run = _Run(project, emit, should_stop)
        photo_set, looks = _photos(run, photos, settings)
        project.put("photo_folder", str(photos.resolve()))
        project.put("engine_version", __version__)
        work, forecast, calibration = plan_and_forecast(
            photo_set,
            looks,
            settings.plan,
            cameras=settings.cameras,
            model=settings.camera_model,
            n_prompts=len(settings.prompts),
            emit=emit,
        )
        require_fit(forecast, work, calibration)
        store_forecast(project, work, forecast)
        training = training_settings(work)
        try:
            camera_set = _cameras(run, photo_set, settings)
            plan = plan_scene(work, camera_set)
            project.put("plan", asdict(plan))
            masks = _masks(run, photo_set, camera_set, plan, settings)
            earlier = _keys(project, masks)
            _training(run, photo_set, camera_set, plan, masks, training, work.preset, earlier)
            _objects(run, settings)
            _report(run)
        finally:
            # What did end is worth knowing for the next forecast, also when the rest was stopped.
            learn_from(project, run.computed, work, training, forecast, calibration)
        return project


@dataclass(frozen=True)
class Prepared:
    """All that training needs, made once and used by every preset of a comparison.

    Attributes
    ----------
    photo_set : PhotoSet
    looks : sequence of PhotoLook
    camera_set : CameraSet
    masks : dict of str to Path
        Label maps by photo name.
    earlier : list
        Keys of the stages that it comes from.
    """

    photo_set: PhotoSet
    looks: Sequence[PhotoLook]
    camera_set: CameraSet
    masks: dict[str, Path]
    earlier: list[Any]


def prepare(photos: Path, out: Path, settings: PipelineSettings, *, emit: Emit, should_stop: StopCheck) -> Prepared:
    """Read the photos and find the cameras in the project folder `out`; parameters and errors as of `reconstruct`."""
    with ProjectFolder.create(out) as project:
        run = _Run(project, emit, should_stop)
        photo_set, looks = _photos(run, photos, settings)
        project.put("photo_folder", str(photos.resolve()))
        camera_set = _cameras(run, photo_set, settings)
        return Prepared(photo_set, looks, camera_set, {}, _keys(project, {}))


def prepare_masks(
    prepared: Prepared, out: Path, work: WorkPlan, settings: PipelineSettings, *, emit: Emit, should_stop: StopCheck
) -> tuple[Prepared, ProjectFolder]:
    """Make the label maps that a plan asks for in the project folder `out`, where the stage's record lies then."""
    with ProjectFolder.create(out) as project:
        run = _Run(project, emit, should_stop)
        plan = plan_scene(work, prepared.camera_set)
        masks = _masks(run, prepared.photo_set, prepared.camera_set, plan, settings)
        earlier = [prepared.earlier[0], _keys(project, masks)[1] if masks else prepared.earlier[0]]
        return replace(prepared, masks=masks, earlier=earlier), project


def train_prepared(
    prepared: Prepared, out: Path, work: WorkPlan, training: TrainingSettings, *, emit: Emit, should_stop: StopCheck
) -> ProjectFolder:
    """Train in a project folder of its own, from cameras and masks that lie elsewhere; resumes like `reconstruct`."""
    with ProjectFolder.create(out) as project:
        run = _Run(project, emit, should_stop)
        plan = plan_scene(work, prepared.camera_set)
        masks = {name: path for name, path in prepared.masks.items() if name in plan.mask_photos}
        _training(run, prepared.photo_set, prepared.camera_set, plan, masks, training, work.preset, prepared.earlier)
        return project


def _keys(project: ProjectFolder, masks: dict[str, Path]) -> list[Any]:
    records = [project.stage_record(stage) for stage in ("cameras", "masks" if masks else "cameras")]
    return [record and record["key"] for record in records]


def _photos(run: _Run, folder: Path, settings: PipelineSettings) -> tuple[PhotoSet, list[PhotoLook]]:
    from .photos import look_at_photos, picture_files, read_looks, read_photos
    from .scene import read_photo_set, write_photo_set

    stored = run.project.path / "photos" / "photos.json"
    looked = run.project.path / "photos" / "looks.json"
    masks = settings.photo_masks

    def work() -> dict[str, Any]:
        photo_set = read_photos(folder, settings.photos, masks=masks, emit=run.emit, should_stop=run.should_stop)
        if stored.exists():
            _refuse_another_scene(run.project, folder, photo_set, read_photo_set(stored))
        looks = look_at_photos(photo_set, should_stop=run.should_stop)
        run.replace("photos")
        write_photo_set(stored, photo_set)
        write_json(looked, [asdict(look) for look in looks])
        return {"n_photos": len(photo_set.photos), "rejected": [asdict(photo) for photo in photo_set.rejected]}

    # Changes whenever a photo is added, edited or removed, and not with what else lies there, this project say.
    listing = _listing(folder, picture_files(folder, without=masks))
    of_masks = [] if masks is None else [_listing(masks, sorted(masks.rglob("*.png")))]
    run.stage("photos", stage_key(listing, to_dict(settings.photos), *of_masks), work, [stored, looked])
    return replace(read_photo_set(stored), folder=folder), read_looks(looked)


def _listing(folder: Path, files: Iterable[Path]) -> list[list[Any]]:
    stats = [(path, path.stat()) for path in files]
    return [[str(path.relative_to(folder)), stat.st_size, stat.st_mtime_ns] for path, stat in stats]


def _refuse_another_scene(project: ProjectFolder, folder: Path, photo_set: PhotoSet, before: PhotoSet) -> None:
    """Photos that moved or changed continue a project; wholly other ones would overwrite somebody's scene."""
    same_folder = project.get("photo_folder") in (None, str(folder.resolve()))
    if not same_folder and not {p.sha256 for p in photo_set.photos} & {p.sha256 for p in before.photos}:
        raise ProjectError(
            f"{project.path} holds the scene of other photos ({project.get('photo_folder')}). "
            f"Choose another folder for the scene of {folder}."
        )


def _photo_hashes(photo_set: PhotoSet) -> list[list[str]]:
    return [photo.hashes for photo in photo_set.photos]


def _cameras(run: _Run, photo_set: PhotoSet, settings: PipelineSettings) -> CameraSet:
    from .scene import read_camera_set, write_camera_set

    folder = run.project.path / "cameras"
    model = settings.camera_model
    key = stage_key(_photo_hashes(photo_set), to_dict(settings.cameras), _model_hashes(model))

    def work() -> dict[str, Any]:
        if model is not None:
            from .cameras import read_cameras

            camera_set = read_cameras(model, photo_set)
        else:
            from .cameras import estimate_cameras

            # Features of photos that changed must not be taken for those of the photos that lie here now.
            work_folder = folder / f"sfm-{key[:12]}"
            for old in folder.glob("sfm-*"):
                if old != work_folder:
                    shutil.rmtree(old)
            camera_set = estimate_cameras(
                photo_set, work_folder, settings.cameras, emit=run.emit, should_stop=run.should_stop
            )
        run.replace("cameras")
        write_camera_set(folder, camera_set)
        if camera_set.unregistered:
            run.emit(
                Warned(
                    f"{len(camera_set.unregistered)} photos could not be placed: {', '.join(camera_set.unregistered)}."
                )
            )
        return {
            "n_registered": len(camera_set.cameras),
            "unregistered": list(camera_set.unregistered),
            "reprojection_error": camera_set.reprojection_error,
            "poses_given": camera_set.poses_given,
            "n_points": len(camera_set.points),
        }

    run.stage("cameras", key, work, [folder / "cameras.json", folder / "points.npz"])
    return read_camera_set(folder)


def _model_hashes(model: Path | None) -> list[list[str]]:
    if model is None:
        return []
    files = [model] if model.is_file() else sorted(path for path in model.rglob("*") if path.is_file())
    return [[path.name, file_sha256(path)] for path in files]


def _masks(
    run: _Run, photo_set: PhotoSet, camera_set: CameraSet, plan: ScenePlan, settings: PipelineSettings
) -> dict[str, Path]:
    from .masks import label_map_path

    folder = run.project.path / "masks"
    if not plan.mask_photos:
        return {}

    def work() -> dict[str, Any]:
        from .masks import load_sam, make_masks

        start = time.perf_counter()
        sam = load_sam(settings.masks.model)
        made = make_masks(
            photo_set,
            camera_set,
            plan.mask_photos,
            folder,
            settings.masks,
            sam,
            emit=run.emit,
            should_stop=run.should_stop,
        )
        return {"n_photos": len(made), "seconds_per_photo": (time.perf_counter() - start) / max(1, len(made))}

    hashes = [[photo.name, photo.sha256] for photo in photo_set.photos if photo.name in plan.mask_photos]
    paths = {name: label_map_path(folder, name) for name in plan.mask_photos}
    run.stage("masks", stage_key(hashes, to_dict(settings.masks)), work, paths.values())
    return paths


def _training(
    run: _Run,
    photo_set: PhotoSet,
    camera_set: CameraSet,
    plan: ScenePlan,
    masks: dict[str, Path],
    training: TrainingSettings,
    preset: str,
    earlier: list[Any],
) -> None:
    # Not the whole plan: its words about what is left out may change without anything that is done.
    key = stage_key(earlier, [plan.held_out, plan.mask_photos, plan.features], to_dict(training))

    def work() -> dict[str, Any]:
        from .gaussians import save_gaussians
        from .training import forget_old_runs, load_views, start_gaussians, train

        checkpoints = run.project.path / "checkpoints"
        forget_old_runs(checkpoints, keep=key[:12])
        views = load_views(
            photo_set.folder,
            camera_set,
            masks,
            training,
            photo_masks=photo_set.mask_files,
            should_stop=run.should_stop,
        )
        start = start_gaussians(camera_set, views, training, emit=run.emit)
        result = train(
            start, views, training, checkpoints=checkpoints / key[:12], emit=run.emit, should_stop=run.should_stop
        )
        run.replace("training")
        _set_old_objects_aside(run)
        save_gaussians(run.project.path / "gaussians", result.gaussians)
        figures = dict(result.figures)
        figures.update(
            preset=preset,
            curve=[asdict(point) for point in result.curve],
            held_out=list(plan.held_out),
            n_gaussians=len(result.gaussians),
        )
        return figures

    leaves = ["scene.ply", "features.npy"] if masks else ["scene.ply"]
    run.stage("training", key, work, [run.project.path / "gaussians" / name for name in leaves])


def _set_old_objects_aside(run: _Run) -> None:
    """Objects point at Gaussians by index: those of an earlier training are kept, under another name."""
    objects = run.project.path / "objects"
    if not objects.is_dir() or not any(objects.iterdir()):
        return
    number = 1
    while (aside := run.project.path / f"objects-of-earlier-training-{number}").exists():
        number += 1
    run.project.put(_PROMPTED, None)
    run.project.forget_stages(["objects"])
    objects.rename(aside)
    run.emit(
        Warned(f"The scene is trained anew; objects isolated before were moved to {aside.name}. Isolate them again.")
    )


def _objects(run: _Run, settings: PipelineSettings) -> None:
    if not settings.prompts:
        return
    training = run.project.stage_record("training")
    key = stage_key(training and training["key"], settings.prompts, to_dict(settings.segment))

    def work() -> dict[str, Any]:
        from .errors import PromptError
        from .grounding import load_default_detector
        from .masks import load_sam
        from .objects import TextPrompt, load_context, segment_project

        sam_factory = functools.partial(load_sam, settings.masks.model)
        found = _found_before(run, key)
        refused: dict[str, str] = {}
        trained = load_context(run.project, settings.segment, sam_factory)
        for number, prompt in enumerate(settings.prompts):
            if prompt in found:
                continue
            try:
                records = segment_project(
                    run.project,
                    TextPrompt(prompt),
                    prompt,
                    settings.segment,
                    detector_factory=load_default_detector,
                    sam_factory=sam_factory,
                    emit=part_of(run.emit, number, len(settings.prompts)),
                    should_stop=run.should_stop,
                    trained=trained,
                )
            except PromptError as error:
                # One prompt that finds nothing must not cost the person the others.
                refused[prompt] = str(error)
                run.emit(Warned(str(error)))
                continue
            found[prompt] = [record.id for record in records]
            run.project.put(_PROMPTED, {"key": key, "found": found})
        return {"found": found, "refused": refused}

    run.stage("objects", key, work)


def _found_before(run: _Run, key: str) -> dict[str, list[str]]:
    """Return what a killed run of this very stage found; what this stage made for other settings is removed."""
    from .objects import delete_object, list_objects

    before = run.project.get(_PROMPTED) or {"key": key, "found": {}}
    found: dict[str, list[str]] = before["found"]
    if before["key"] == key:
        return found
    there = {record.id for record in list_objects(run.project.path)}
    for object_id in [one for ids in found.values() for one in ids if one in there]:
        delete_object(run.project.path, object_id)
    return {}


def _report(run: _Run) -> None:
    from .report import build_report

    earlier = [run.project.stage_record(stage) for stage in STAGES[:-1]]

    def work() -> dict[str, Any]:
        return {"html": str(build_report(run.project).relative_to(run.project.path))}

    page = run.project.path / "report" / "report.html"
    run.stage("report", stage_key([record and record["key"] for record in earlier]), work, [page])
