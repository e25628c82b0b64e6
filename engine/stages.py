"""The stages of the pipeline, one function each: photos, cameras, masks, training, objects, report.

Each function computes its stage and stores the result in the project, or reuses what an earlier run stored: a stage is
done when its key, a hash of everything it read, stands in ``project.json`` and its files exist. Heavy packages are
imported inside the functions, so that a stage that is reused costs nothing.
"""

from __future__ import annotations

import functools
import shutil
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from .cameras.settings import CameraSettings
from .errors import Cancelled, ProjectError
from .events import Emit, StageFinished, StageStarted, StopCheck, Warned
from .files import file_sha256, write_json
from .machine import PeakMemory, cpu_seconds
from .masks.settings import MaskSettings
from .objects.settings import SegmentSettings
from .photos import PhotoStatistics
from .photos.settings import PhotoSettings
from .planning import ScenePlan
from .project_folder import ProjectFolder, stage_key
from .scene import CameraSet, PhotoSet
from .settings import to_dict
from .training.settings import TrainingSettings

__all__ = [
    "STAGES",
    "StageRunner",
    "TrainingInput",
    "cameras_stage",
    "masks_stage",
    "objects_stage",
    "photos_stage",
    "report_stage",
    "training_stage",
]

STAGES = ("photos", "cameras", "masks", "training", "objects", "report")

_FOUND_BY_PROMPT = "objects_by_prompt"
"""Name in ``project.json`` of what each prompt has found so far: a killed run continues after it."""
_BEGUN = "begun"
"""Name in ``project.json`` of the stage that was begun last and its key: what it took is then not measured whole."""


@dataclass(frozen=True)
class StageRunner:
    """Runs the stages of one project.

    Attributes
    ----------
    project : ProjectFolder
        Held for writing.
    emit, should_stop
        See `engine.events`.
    computed : list of str
        Stages that this run computed, in order; the others were reused.
    """

    project: ProjectFolder
    emit: Emit
    should_stop: StopCheck
    computed: list[str] = field(default_factory=list)

    def run(self, stage: str, key: str, compute: Callable[[], dict[str, Any]], outputs: Iterable[Path] = ()) -> None:
        """Run `compute` unless `stage` is done with this `key` and its `outputs` exist; store its figures and cost."""
        if self.should_stop():
            raise Cancelled(f"Stopped before the stage {stage!r}. Run the same command again to continue.")
        self.emit(StageStarted(stage))
        wall, cpu = time.perf_counter(), cpu_seconds()
        reused = self.project.stage_is_done(stage, key) and all(path.is_file() for path in outputs)
        if not reused:
            continued = self.project.get(_BEGUN) == [stage, key]
            # Reading photos leaves nothing half-done, and may be refused, which must change nothing in the project.
            if stage != "photos":
                self.project.put(_BEGUN, [stage, key])
            with PeakMemory.of() as peak:
                figures = compute()
            self.project.finish_stage(
                stage,
                key,
                wall_seconds=time.perf_counter() - wall,
                cpu_seconds=cpu_seconds() - cpu,
                figures=figures,
                peak_memory=peak.bytes,
                continued=continued,
            )
            self.computed.append(stage)
        self.emit(StageFinished(stage, time.perf_counter() - wall, reused))

    def before_replacing_outputs(self, stage: str) -> None:
        """Mark `stage` as not done before its files are replaced: after a kill they must not count as done."""
        self.project.forget_stages([stage])

    def key_of(self, stage: str) -> str | None:
        """Return the key that `stage` was done with, None while it is not done."""
        record = self.project.stage_record(stage)
        return None if record is None else record["key"]


def photos_stage(
    runner: StageRunner, folder: Path, settings: PhotoSettings, *, photo_masks: Path | None
) -> tuple[PhotoSet, list[PhotoStatistics]]:
    """Read and check the photos in `folder`.

    Parameters
    ----------
    runner : StageRunner
    folder : Path
    settings : PhotoSettings
    photo_masks : Path or None
        Folder of masks that say which pixels count, see `photos.photo_masks`.

    Raises
    ------
    ProjectError
        When the project holds the scene of other photos.
    """
    from .photos import inspect_photos, picture_files, read_photo_statistics, read_photos
    from .scene import read_photo_set, write_photo_set

    stored = runner.project.path / "photos" / "photos.json"
    stored_statistics = runner.project.path / "photos" / "looks.json"

    def compute() -> dict[str, Any]:
        photo_set = read_photos(folder, settings, masks=photo_masks, emit=runner.emit, should_stop=runner.should_stop)
        if stored.exists():
            _require_same_scene(runner.project, folder, photo_set, read_photo_set(stored))
        statistics = inspect_photos(photo_set, should_stop=runner.should_stop)
        runner.before_replacing_outputs("photos")
        write_photo_set(stored, photo_set)
        write_json(stored_statistics, [asdict(photo) for photo in statistics])
        return {"n_photos": len(photo_set.photos), "rejected": [asdict(photo) for photo in photo_set.rejected]}

    # Changes when a photo is added, edited or removed, and not with other files in the folder, this project among them.
    listing = _listing(folder, picture_files(folder, without=photo_masks))
    mask_listing = [] if photo_masks is None else [_listing(photo_masks, sorted(photo_masks.rglob("*.png")))]
    runner.run("photos", stage_key(listing, to_dict(settings), *mask_listing), compute, [stored, stored_statistics])
    return replace(read_photo_set(stored), folder=folder), read_photo_statistics(stored_statistics)


def _listing(folder: Path, files: Iterable[Path]) -> list[list[Any]]:
    stats = [(path, path.stat()) for path in files]
    return [[str(path.relative_to(folder)), stat.st_size, stat.st_mtime_ns] for path, stat in stats]


def _require_same_scene(project: ProjectFolder, folder: Path, photo_set: PhotoSet, before: PhotoSet) -> None:
    """Photos that moved or changed continue a project; entirely different ones would overwrite another scene."""
    same_folder = project.get("photo_folder") in (None, str(folder.resolve()))
    if not same_folder and not {p.sha256 for p in photo_set.photos} & {p.sha256 for p in before.photos}:
        raise ProjectError(
            f"{project.path} holds the scene of other photos ({project.get('photo_folder')}). "
            f"Choose another folder for the scene of {folder}."
        )


def cameras_stage(
    runner: StageRunner, photo_set: PhotoSet, settings: CameraSettings, *, camera_model: Path | None
) -> CameraSet:
    """Estimate the cameras of the photos, or read them from `camera_model`.

    Parameters
    ----------
    runner : StageRunner
    photo_set : PhotoSet
    settings : CameraSettings
    camera_model : Path or None
        Folder of a COLMAP model, or a ``transforms.json``, to read instead of estimating.
    """
    from .scene import read_camera_set, write_camera_set

    folder = runner.project.path / "cameras"
    hashes = [photo.hashes for photo in photo_set.photos]
    key = stage_key(hashes, to_dict(settings), _hashes_of_model(camera_model))

    def compute() -> dict[str, Any]:
        if camera_model is not None:
            from .cameras import read_cameras

            camera_set = read_cameras(camera_model, photo_set)
        else:
            from .cameras import estimate_cameras

            # Features of photos that have changed since must not be taken for those of the present photos.
            work_folder = folder / f"sfm-{key[:12]}"
            for old in folder.glob("sfm-*"):
                if old != work_folder:
                    shutil.rmtree(old)
            camera_set = estimate_cameras(
                photo_set, work_folder, settings, emit=runner.emit, should_stop=runner.should_stop
            )
        runner.before_replacing_outputs("cameras")
        write_camera_set(folder, camera_set)
        if camera_set.unregistered:
            names = ", ".join(camera_set.unregistered)
            runner.emit(Warned(f"{len(camera_set.unregistered)} photos could not be placed: {names}."))
        return {
            "n_registered": len(camera_set.cameras),
            "unregistered": list(camera_set.unregistered),
            "reprojection_error": camera_set.reprojection_error,
            "poses_given": camera_set.poses_given,
            "n_points": len(camera_set.points),
        }

    runner.run("cameras", key, compute, [folder / "cameras.json", folder / "points.npz"])
    return read_camera_set(folder)


def _hashes_of_model(model: Path | None) -> list[list[str]]:
    if model is None:
        return []
    files = [model] if model.is_file() else sorted(path for path in model.rglob("*") if path.is_file())
    return [[path.name, file_sha256(path)] for path in files]


def masks_stage(
    runner: StageRunner, photo_set: PhotoSet, camera_set: CameraSet, plan: ScenePlan, settings: MaskSettings
) -> dict[str, Path]:
    """Segment the photos that the plan names and return the files of their label maps by photo; none, no stage."""
    from .masks import label_map_path

    folder = runner.project.path / "masks"
    if not plan.mask_photos:
        return {}

    def compute() -> dict[str, Any]:
        from .masks import load_sam, make_masks

        start = time.perf_counter()
        sam = load_sam(settings.model)
        made = make_masks(
            photo_set,
            camera_set,
            plan.mask_photos,
            folder,
            settings,
            sam,
            emit=runner.emit,
            should_stop=runner.should_stop,
        )
        return {"n_photos": len(made), "seconds_per_photo": (time.perf_counter() - start) / max(1, len(made))}

    hashes = [[photo.name, photo.sha256] for photo in photo_set.photos if photo.name in plan.mask_photos]
    paths = {name: label_map_path(folder, name) for name in plan.mask_photos}
    runner.run("masks", stage_key(hashes, to_dict(settings)), compute, paths.values())
    return paths


@dataclass(frozen=True)
class TrainingInput:
    """What the stages before training made.

    Attributes
    ----------
    photo_set : PhotoSet
    camera_set : CameraSet
    label_maps : dict of str to Path
        Files of the label maps by photo; empty without objects.
    cameras_key, masks_key : str or None
        Keys of the stages that made them; `masks_key` is the cameras' key when there are no label maps.
    """

    photo_set: PhotoSet
    camera_set: CameraSet
    label_maps: dict[str, Path]
    cameras_key: str | None
    masks_key: str | None


def training_stage(
    runner: StageRunner, given: TrainingInput, plan: ScenePlan, settings: TrainingSettings, *, preset: str
) -> None:
    """Train the Gaussians and store them in the project; objects of an earlier training are moved aside.

    Parameters
    ----------
    runner : StageRunner
    given : TrainingInput
    plan : ScenePlan
    settings : TrainingSettings
    preset : str
        Name of the preset that `settings` come from, for the report.
    """
    # Not the whole plan: its sentences about what is left out may change without a change of the result.
    inputs = [given.cameras_key, given.masks_key]
    key = stage_key(inputs, [plan.held_out, plan.mask_photos, plan.features], to_dict(settings))

    def compute() -> dict[str, Any]:
        from .gaussians import save_gaussians
        from .training import delete_old_runs, load_views, start_gaussians, train

        checkpoints = runner.project.path / "checkpoints"
        delete_old_runs(checkpoints, keep=key[:12])
        views = load_views(
            given.photo_set.folder,
            given.camera_set,
            given.label_maps,
            settings,
            photo_masks=given.photo_set.mask_files,
            should_stop=runner.should_stop,
        )
        start = start_gaussians(given.camera_set, views, settings, emit=runner.emit)
        result = train(
            start,
            views,
            settings,
            checkpoints=checkpoints / key[:12],
            emit=runner.emit,
            should_stop=runner.should_stop,
        )
        runner.before_replacing_outputs("training")
        _move_old_objects_aside(runner)
        save_gaussians(runner.project.path / "gaussians", result.gaussians)
        return {
            **result.figures,
            "preset": preset,
            "curve": [asdict(point) for point in result.curve],
            "held_out": list(plan.held_out),
            "n_gaussians": len(result.gaussians),
        }

    files = ["scene.ply", "features.npy"] if given.label_maps else ["scene.ply"]
    runner.run("training", key, compute, [runner.project.path / "gaussians" / name for name in files])


def _move_old_objects_aside(runner: StageRunner) -> None:
    """Objects refer to Gaussians by index: those of an earlier training are kept in a folder of another name."""
    objects = runner.project.path / "objects"
    if not objects.is_dir() or not any(objects.iterdir()):
        return
    number = 1
    while (aside := runner.project.path / f"objects-of-earlier-training-{number}").exists():
        number += 1
    runner.project.put(_FOUND_BY_PROMPT, None)
    runner.project.forget_stages(["objects"])
    objects.rename(aside)
    runner.emit(
        Warned(
            f"The scene is trained again; the objects isolated before were moved to {aside.name}. Isolate them again."
        )
    )


def objects_stage(runner: StageRunner, prompts: Sequence[str], settings: SegmentSettings, *, sam_model: str) -> None:
    """Isolate what the texts `prompts` name; nothing to do without any.

    Parameters
    ----------
    runner : StageRunner
    prompts : sequence of str
    settings : SegmentSettings
    sam_model : str
        Name of the Segment Anything model, see `MaskSettings.model`.
    """
    if not prompts:
        return
    key = stage_key(runner.key_of("training"), tuple(prompts), to_dict(settings))

    def compute() -> dict[str, Any]:
        from .grounding import load_default_detector
        from .masks import load_sam
        from .objects import load_context, segment_each_text

        found = _found_before(runner, key)
        refused: dict[str, str] = {}
        context = load_context(runner.project, settings, functools.partial(load_sam, sam_model))
        for result in segment_each_text(
            runner.project,
            context,
            {prompt: prompt for prompt in prompts},
            settings,
            detector_factory=load_default_detector,
            emit=runner.emit,
            should_stop=runner.should_stop,
            skip=tuple(found),
        ):
            if result.refusal:
                refused[result.text] = result.refusal
                runner.emit(Warned(result.refusal))
                continue
            found[result.text] = [record.id for record in result.records]
            runner.project.put(_FOUND_BY_PROMPT, {"key": key, "found": found})
        return {"found": found, "refused": refused}

    runner.run("objects", key, compute)


def _found_before(runner: StageRunner, key: str) -> dict[str, list[str]]:
    """Return what a killed run of this very stage found; objects that it made with other settings are deleted."""
    from .objects import delete_object, list_objects

    before = runner.project.get(_FOUND_BY_PROMPT) or {"key": key, "found": {}}
    found: dict[str, list[str]] = before["found"]
    if before["key"] == key:
        return found
    existing = {record.id for record in list_objects(runner.project.path)}
    for object_id in [one for ids in found.values() for one in ids if one in existing]:
        delete_object(runner.project.path, object_id)
    return {}


def report_stage(runner: StageRunner) -> None:
    """Write the report of what the other stages did."""
    from .report import build_report

    def compute() -> dict[str, Any]:
        return {"html": str(build_report(runner.project).relative_to(runner.project.path))}

    page = runner.project.path / "report" / "report.html"
    runner.run("report", stage_key([runner.key_of(stage) for stage in STAGES[:-1]]), compute, [page])
