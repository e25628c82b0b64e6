"""The stages of the pipeline, one function each: photos, cameras, masks, training, objects, report.

Each function computes its stage and stores the result in the project, or reuses what an earlier run stored: a stage is
done when its key, a hash of everything it read, stands in ``project.json`` and its files are as recorded there. Heavy
packages are imported inside the functions, so that a stage that is reused costs little.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from ..cameras.settings import CameraSettings
from ..core.errors import EnvironmentProblem, FormatError, ProjectError
from ..core.events import Progress, Warned
from ..core.files import delete_derived, file_sha256, record_of, write_json
from ..core.language import languages
from ..core.parts import part
from ..core.settings import to_dict
from ..masks import MasksBeside
from ..masks.settings import MaskSettings
from ..photos import PhotoStatistics
from ..photos.settings import PhotoSettings
from ..project.content import report_file
from ..project.folder import SCENE_OUTPUT, ProjectFolder, stage_key
from ..rasterizer import PROCESSOR, Device, device_words, run_on, training_stopped
from ..scene import CameraSet, PhotoSet
from ..training.settings import TrainingSettings
from .first_picture import FirstPicture
from .objects_stage import forget_found_objects
from .planning import ScenePlan
from .runner import StageRunner, parts_by_message

STAGES = ("photos", "cameras", "masks", "training", "objects", "report")


def photos_stage(
    runner: StageRunner,
    folder: Path,
    settings: PhotoSettings,
    *,
    photo_masks: Path | None,
    background_sam: str | None = None,
) -> tuple[PhotoSet, list[PhotoStatistics]]:
    """Read and check the photos in `folder`.

    Parameters
    ----------
    photo_masks : Path or None
        Folder of masks that say which pixels count, see `photos.photo_masks`.
    background_sam : str or None
        Name of the SAM model that makes such masks, which leave out the background; None for none.

    Raises
    ------
    ProjectError
        When the project holds the scene of other photos.
    """
    from ..photos import file_listing, inspect_photos, mask_files, picture_files, read_photo_statistics, read_photos
    from ..scene import read_photo_set, write_photo_set

    stored = runner.project.path / "photos" / "photos.json"
    stored_statistics = runner.project.path / "photos" / "looks.json"
    own_masks = runner.project.path / "photos" / "masks"

    def compute() -> dict[str, Any]:
        with part("reading photos"):
            photo_set = read_photos(
                folder, settings, masks=photo_masks, emit=runner.emit, should_stop=runner.should_stop
            )
        if stored.exists():
            _require_same_scene(runner.project, folder, photo_set, stored)
        if background_sam is not None:
            photo_set = _with_foreground_masks(runner, photo_set, own_masks, background_sam)
        with part("inspecting photos"):
            statistics = inspect_photos(photo_set, should_stop=runner.should_stop)
        runner.before_replacing_outputs("photos")
        write_photo_set(stored, photo_set)
        write_json(stored_statistics, [asdict(photo) for photo in statistics])
        return {"n_photos": len(photo_set.photos), "rejected": [asdict(photo) for photo in photo_set.rejected]}

    # Changes when a photo is added, edited or removed, and not with other files in the folder, this project among them.
    listing = file_listing(folder, picture_files(folder, without=photo_masks))
    mask_listing: list[Any] = [] if photo_masks is None else [file_listing(photo_masks, mask_files(photo_masks))]
    mask_listing += [] if background_sam is None else [background_sam]
    key = stage_key(listing, to_dict(settings), *mask_listing)
    runner.run("photos", key, compute, [stored, stored_statistics], settings=to_dict(settings))
    photo_set = replace(read_photo_set(stored), folder=folder)
    if background_sam is not None:
        # The project may have moved since.
        photos = (
            replace(photo, mask=photo.mask and str(own_masks / f"{photo.name}.png")) for photo in photo_set.photos
        )
        photo_set = replace(photo_set, photos=tuple(photos))
    return photo_set, read_photo_statistics(stored_statistics)


def _with_foreground_masks(runner: StageRunner, photo_set: PhotoSet, masks: Path, sam: str) -> PhotoSet:
    """Return the photos with masks of the object before its background, which are made in the folder `masks`."""
    from ..masks import load_sam, make_foreground_masks
    from ..photos import with_masks

    delete_derived(masks.parent, masks.name)
    make_foreground_masks(
        photo_set, masks, lambda: load_sam(sam, may_use_gpu=False), emit=runner.emit, should_stop=runner.should_stop
    )
    photos = with_masks(photo_set.folder, photo_set.photos, masks, emit=runner.emit, should_stop=runner.should_stop)
    return replace(photo_set, photos=photos)


def _require_same_scene(project: ProjectFolder, folder: Path, photo_set: PhotoSet, stored: Path) -> None:
    """Photos that moved or changed continue a project; entirely different ones would overwrite another scene."""
    from ..scene import read_photo_set

    if project.get("photo_folder") in (None, str(folder.resolve())):
        return
    try:
        before = {photo.sha256 for photo in read_photo_set(stored).photos}
    except FormatError:
        before = set()
    if not {photo.sha256 for photo in photo_set.photos} & before:
        raise ProjectError(
            f"{project.path} holds the scene of other photos ({project.get('photo_folder')}). "
            f"Choose another folder for the scene of {folder}."
        )


def cameras_stage(
    runner: StageRunner,
    photo_set: PhotoSet,
    settings: CameraSettings,
    *,
    given_cameras: Path | None,
    beside: Sequence[MasksBeside | FirstPicture] = (),
) -> CameraSet:
    """Estimate the cameras of the photos, or read them from `given_cameras`. If they change, training starts anew.

    Parameters
    ----------
    given_cameras : Path or None
        Cameras of another program to read instead of estimating, see `engine.cameras.read_cameras`.
    beside : sequence of MasksBeside or FirstPicture
        What is started when cameras are estimated.
    """
    from ..scene import read_camera_set, write_camera_set

    folder = runner.project.path / "cameras"
    hashes = [photo.hashes for photo in photo_set.photos]
    key = stage_key(hashes, to_dict(settings), _hashes_of_model(given_cameras))

    def compute() -> dict[str, Any]:
        if given_cameras is not None:
            from ..cameras import check_given_cameras, read_cameras

            camera_set = read_cameras(given_cameras, photo_set, emit=runner.emit, should_stop=runner.should_stop)
            camera_set = check_given_cameras(camera_set, photo_set, emit=runner.emit, should_stop=runner.should_stop)
        else:
            from ..cameras import estimate_cameras

            # Features of photos that have changed since must not be taken for those of the present photos.
            work_folder = folder / f"sfm-{key[:12]}"
            for old in folder.glob("sfm-*"):
                if old != work_folder:
                    delete_derived(folder, old.name)
            for other in beside:
                other.start()
            with parts_by_message(runner.emit) as emit:
                camera_set = estimate_cameras(
                    photo_set, work_folder, settings, emit=emit, should_stop=runner.should_stop
                )
        runner.before_replacing_outputs("cameras")
        write_camera_set(folder, camera_set)
        # Not those of before: COLMAP's poses depend on the number of threads. A scene fits only the cameras that it
        # was trained with.
        if runner.project.damaged_outputs("cameras"):
            runner.project.forget_stages(["training"])
        if camera_set.unregistered:
            names = ", ".join(camera_set.unregistered)
            runner.emit(Warned(f"{len(camera_set.unregistered)} photos could not be placed: {names}."))
        return {
            "n_registered": len(camera_set.cameras),
            "unregistered": list(camera_set.unregistered),
            "reprojection_error": camera_set.reprojection_error,
            "poses_given": camera_set.poses_given,
            "n_points": len(camera_set.points),
            "health": None if camera_set.health is None else asdict(camera_set.health),
        }

    outputs = [folder / "cameras.json", folder / "points.npz"]
    runner.run("cameras", key, compute, outputs, settings=to_dict(settings))
    return read_camera_set(folder)


def _hashes_of_model(model: Path | None) -> list[list[str]]:
    if model is None:
        return []
    from ..cameras import files_of_model

    return [[path.name, file_sha256(path)] for path in files_of_model(model)]


def masks_stage(
    runner: StageRunner,
    photo_set: PhotoSet,
    plan: ScenePlan,
    settings: MaskSettings,
    *,
    beside: MasksBeside | None = None,
) -> dict[str, Path]:
    """Segment the photos that the plan names and return the files of their label maps by photo; none, no stage.

    Parameters
    ----------
    beside : MasksBeside or None
        What the cameras stage may have started. It is ended, and the stage makes the label maps that are missing.
    """
    from ..masks import label_map_path

    folder = runner.project.path / "masks"
    if not plan.mask_photos:
        return {}

    def compute() -> dict[str, Any]:
        from ..install.models import gpu_provider_is_installed
        from ..masks import (
            SegmentAnything,
            card_encodes,
            load_sam,
            make_masks,
            make_masks_with_helpers,
            sam_threads,
        )

        start = time.perf_counter()
        with part("made beside the cameras"):
            made_before = beside.end() if beside is not None else None
        if made_before is not None and made_before.problem:
            runner.emit(Warned(f"Not all photos were segmented beside the cameras: {made_before.problem}"))

        def load() -> SegmentAnything:
            may_use_gpu = True
            if gpu_provider_is_installed():
                # First in a process of its own: a driver that crashes would end the run.
                with part("self-test of the card"):
                    may_use_gpu, sentence = card_encodes()
                if not may_use_gpu:
                    runner.emit(Warned(sentence))
            with part("loading models"):
                return load_sam(settings.model, threads=sam_threads(settings), may_use_gpu=may_use_gpu)

        # Label maps are replaced one by one.
        runner.before_replacing_outputs("masks")
        if not gpu_provider_is_installed():
            with part("made with helpers"):
                make_masks_with_helpers(
                    photo_set, runner.project.path / "photos" / "photos.json", plan.mask_photos, folder, settings,
                    emit=runner.emit, should_stop=runner.should_stop,
                )  # fmt: skip
        make_masks(
            photo_set, plan.mask_photos, folder, settings, load, emit=runner.emit, should_stop=runner.should_stop
        )
        seconds = time.perf_counter() - start
        figures: dict[str, Any] = {"n_photos": len(plan.mask_photos)}
        if made_before is not None:
            seconds += made_before.seconds
            figures["beside"] = asdict(made_before)
        return {**figures, "seconds_per_photo": seconds / len(plan.mask_photos)}

    hashes = [[photo.name, photo.sha256] for photo in photo_set.photos if photo.name in plan.mask_photos]
    paths = {name: label_map_path(folder, name) for name in plan.mask_photos}
    key = stage_key(hashes, to_dict(settings))
    runner.run("masks", key, compute, list(paths.values()), settings=to_dict(settings))
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


def on_processor() -> Device:
    """Return the processor as the device to train on."""
    return PROCESSOR


def training_stage(
    runner: StageRunner,
    given: TrainingInput,
    plan: ScenePlan,
    settings: TrainingSettings,
    *,
    preset: str,
    find_device: Callable[[], Device] = on_processor,
) -> None:
    """Train the Gaussians and store them in the project.

    Objects of another scene go to the trash. They stay when training only repeated the scene that they belong to.

    Parameters
    ----------
    preset : str
        Name of the preset that `settings` come from, for the report.
    find_device : callable
        Returns what to train on; called only if the stage is not done. The key does not depend on it.

    Raises
    ------
    EnvironmentProblem
        When memory is full, or the graphics card stops working. The next run continues from the last checkpoint.
    """
    from ..training import key_values

    # Not the whole plan: its sentences about what is left out may change without a change of the result.
    inputs = [given.cameras_key, given.masks_key]
    decided = [plan.held_out, plan.mask_photos, plan.features]
    key = stage_key(inputs, decided, key_values(settings))
    folder = runner.project.path / "gaussians"

    def before_replacing(scene: Path) -> None:
        before = runner.project.recorded_outputs("training").get(SCENE_OUTPUT)
        runner.before_replacing_outputs("training")
        if before is None or record_of(scene) != before:
            _discard_objects(runner)

    def compute() -> dict[str, Any]:
        from ..training import background_gaussians, delete_old_runs, load_views, save_gaussians, start_gaussians, train

        checkpoints = runner.project.path / "checkpoints"
        delete_old_runs(checkpoints, keep=key[:12])
        with part("reading photos"):
            views = load_views(
                given.photo_set.folder,
                given.camera_set,
                given.label_maps,
                settings,
                photo_masks=given.photo_set.mask_files,
                scratch=checkpoints,
                should_stop=runner.should_stop,
            )
        with part("first Gaussians"):
            start = start_gaussians(given.camera_set, views, settings, emit=runner.emit)
            background = background_gaussians(given.camera_set.points, views, settings)
        device = find_device()
        words = device_words(device.name, device.reason)
        runner.emit(Progress("training", 0.0, message=f"training on {words}"))
        try:
            result = train(
                start,
                views,
                settings if settings.backend == "reference" else settings.changed(backend=device.backend),
                checkpoints=checkpoints / key[:12],
                emit=runner.emit,
                should_stop=runner.should_stop,
                background=background,
            )
        except EnvironmentProblem as problem:
            raise training_stopped(device, problem) from problem
        with part("writing"):
            save_gaussians(folder, result.gaussians, before_replacing=before_replacing)
        return {
            **result.figures,
            "preset": preset,
            "device": device.name,
            "curve": [asdict(point) for point in result.curve],
            "held_out": list(plan.held_out),
            "n_gaussians": len(result.gaussians),
        }

    from ..training import FEATURES_FILE, SCENE_FILE

    outputs = [folder / name for name in ((SCENE_FILE, FEATURES_FILE) if given.label_maps else (SCENE_FILE,))]
    runner.run("training", key, compute, outputs, settings=to_dict(settings))


def _discard_objects(runner: StageRunner) -> None:
    """Objects refer to Gaussians by index: those of an earlier training go to the trash."""
    from ..objects import forget_candidates
    from ..project.objects import discard_object, object_ids

    ids = object_ids(runner.project.path)
    if not ids:
        return
    forget_found_objects(runner)
    for object_id in ids:
        discard_object(runner.project, object_id, why="of an earlier training")
    forget_candidates(runner.project.path)
    runner.emit(
        Warned(
            f"The scene is trained again; the objects isolated before were moved to the trash: {', '.join(ids)}. "
            "Isolate them again."
        )
    )


def report_stage(runner: StageRunner, *, find_device: Callable[[], Device]) -> None:
    """Write the report of what the other stages did; see `objects_stage` for `find_device`."""
    from ..delivery.report import build_report

    def compute() -> dict[str, Any]:
        _, device = run_on(find_device(), lambda device: build_report(runner.project, backend=device.backend))
        return {"device": device.name}

    pages = [report_file(runner.project.path, language.code) for language in languages()]
    key = stage_key([runner.key_of(stage) for stage in STAGES[:-1]], [page.name for page in pages])
    runner.run("report", key, compute, pages, settings={})
