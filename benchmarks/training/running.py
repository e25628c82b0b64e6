"""One training of a variant on a photo set, measured; finished ones are kept for as long as the engine is unchanged."""

from __future__ import annotations

import hashlib
import shutil
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from engine.cameras import has_points
from engine.cameras.settings import CameraSettings
from engine.core.events import ignore_events, never_stop
from engine.core.files import read_json, write_json
from engine.masks import load_default_sam
from engine.objects.grounding import load_default_detector
from engine.pipeline.planning import PlanSettings, WorkPlan, plan_scene, plan_work, training_settings
from engine.pipeline.reconstruct import PipelineSettings
from engine.project.folder import ProjectFolder
from engine.quality.bench.prepared import PreparedScene, prepare, prepare_masks, train_prepared
from engine.quality.evaluation import evaluate_project
from engine.quality.evaluation.settings import EvaluationSettings
from engine.scene import CameraSet
from engine.training import load_gaussians, measure_quality

from .photo_sets import ROOT, PhotoSetFolder
from .variants import Variant

_SCHEMA = {"figures": dict}
_PACKAGES = ("cameras", "gaussians", "masks", "photos", "planning", "rasterizer", "scene", "training")
"""Of the engine, whose code decides what a training gives."""


@dataclass(frozen=True)
class Measured:
    """Figures of one training, on test photos unless stated otherwise.

    Attributes
    ----------
    psnr, fitted_psnr, well_seen_psnr : float
        See `engine.training.quality.MeasuredQuality`; `well_seen_psnr` is None without such pixels.
    ssim, l1, flip, well_seen_share, dark_share : float
    dark_share_trained : float
        `dark_share` on training photos.
    trained_psnr : float
        On training photos.
    steps, n_gaussians : int
    cpu_seconds : float
        Of training.
    iou : float or None
        Mean IoU of the objects by mask, in percent; None without ground truth or features.
    """

    psnr: float
    fitted_psnr: float
    well_seen_psnr: float | None
    ssim: float
    l1: float
    flip: float
    well_seen_share: float
    dark_share: float
    dark_share_trained: float
    trained_psnr: float
    steps: int
    n_gaussians: int
    cpu_seconds: float
    iou: float | None


class TrainingBench:
    """Trains and measures variants.

    Parameters
    ----------
    out : Path
        Cameras and masks of each set are kept in ``scenes``, trainings in a folder for the state of the engine.
    preset : str
    objects : bool
        Whether the objects of sets with ground truth are evaluated, too.
    """

    def __init__(self, out: Path, *, preset: str, objects: bool) -> None:
        self.out, self.preset, self.objects = out, preset, objects
        self._runs = out / engine_state()
        self._prepared: dict[str, PreparedScene] = {}

    def measured(self, photos: PhotoSetFolder, variant: Variant, seed: int) -> Measured:
        """Return the figures of a training; one that was measured before is not repeated.

        Raises
        ------
        HeritageError
            As the stages of the pipeline.
        """
        folder = self.folder(photos, variant, seed)
        file = folder / "measured.json"
        wants_objects = self.objects and photos.truth is not None and variant.features
        if file.exists():
            figures = read_json(file, _SCHEMA, advice="Delete it, then run again.")["figures"]
            if figures["iou"] is not None or not wants_objects:
                return Measured(**figures)
        measured = self._measure(photos, variant, seed, folder, wants_objects=wants_objects)
        write_json(file, {"figures": asdict(measured)})
        return measured

    def cameras(self, photos: PhotoSetFolder) -> CameraSet:
        """Return the cameras of a set, estimated or read at the first call.

        Raises
        ------
        HeritageError
            As the stages of the pipeline.
        """
        return self._with_cameras(photos).camera_set

    def prepared(self, photos: PhotoSetFolder) -> PreparedScene:
        """Return photos, cameras and masks of a set, made at the first call.

        Raises
        ------
        HeritageError
            As the stages of the pipeline.
        """
        return self._prepare(photos, Variant("as-planned"))

    def folder(self, photos: PhotoSetFolder, variant: Variant, seed: int) -> Path:
        """Return the project folder of a training."""
        return self._runs / photos.name / f"{self.preset}-{variant.name}-{seed}"

    def _measure(
        self, photos: PhotoSetFolder, variant: Variant, seed: int, folder: Path, *, wants_objects: bool
    ) -> Measured:
        work, prepared = self._work(photos, variant), self._prepare(photos, variant)
        training = training_settings(work).changed(seed=seed, **variant.changes)
        if photos.max_gaussians is not None:
            work = replace(work, max_gaussians=photos.max_gaussians)
            training = training.changed(max_gaussians=photos.max_gaussians)
        if not variant.features:
            prepared = replace(prepared, label_maps={})
        project = train_prepared(prepared, folder, work, training, emit=ignore_events, should_stop=never_stop)
        figures: dict[str, Any] = (project.stage_record("training") or {})["figures"]
        gaussians = load_gaussians(folder / "gaussians")
        held_out = plan_scene(work, prepared.camera_set).held_out
        registered = [camera.photo for camera in prepared.camera_set.cameras]
        trained = [name for name in registered if name not in held_out]
        test, training_photos = (
            measure_quality(
                gaussians, photos.photos, prepared.camera_set, names, trained=trained,
                max_side=training.schedule.max_side, should_stop=never_stop,
            )
            for names in (held_out, trained)
        )  # fmt: skip
        return Measured(
            test.quality.psnr, test.fitted.psnr, test.well_seen.psnr if test.well_seen else None, test.quality.ssim,
            test.quality.l1, test.flip, test.well_seen_share, test.dark_share, training_photos.dark_share,
            training_photos.quality.psnr, figures["steps"], len(gaussians), figures["cpu_seconds"],
            self._iou(project, photos) if wants_objects else None,
        )  # fmt: skip

    def _iou(self, project: ProjectFolder, photos: PhotoSetFolder) -> float:
        assert photos.truth is not None
        scene = self._scene(photos)
        for part in ("cameras", "masks"):
            shutil.copytree(scene / part, project.path / part, dirs_exist_ok=True)
        project.put("photo_folder", str(photos.photos.resolve()))
        rows = evaluate_project(
            project, photos.truth, EvaluationSettings(presets=("better",)), detector_factory=load_default_detector,
            sam_factory=load_default_sam, emit=ignore_events, should_stop=never_stop,
        ).rows  # fmt: skip
        return 100.0 * sum(row.iou for row in rows) / len(rows)

    def _work(self, photos: PhotoSetFolder, variant: Variant) -> WorkPlan:
        settings = PlanSettings(preset=self.preset, wants_objects=variant.features)
        return self._plan(photos, self._with_cameras(photos), settings)

    def _plan(self, photos: PhotoSetFolder, prepared: PreparedScene, settings: PlanSettings) -> WorkPlan:
        return plan_work(
            prepared.photo_set, prepared.statistics, settings, cameras=CameraSettings(),
            poses_given=photos.cameras is not None,
            points_given=photos.cameras is not None and has_points(photos.cameras),
        )  # fmt: skip

    def _prepare(self, photos: PhotoSetFolder, variant: Variant) -> PreparedScene:
        """Return photos, cameras and, for features, masks of a set, made at the first call."""
        if not variant.features:
            return self._with_cameras(photos)
        if photos.name not in self._prepared:
            settings, scene = PipelineSettings(given_cameras=photos.cameras), self._scene(photos)
            prepared = self._with_cameras(photos)
            work = self._plan(photos, prepared, PlanSettings(preset=self.preset))
            prepared, _ = prepare_masks(prepared, scene, work, settings, emit=ignore_events, should_stop=never_stop)
            self._prepared[photos.name] = prepared
        return self._prepared[photos.name]

    def _with_cameras(self, photos: PhotoSetFolder) -> PreparedScene:
        """Return photos and cameras of a set, without masks."""
        settings = PipelineSettings(given_cameras=photos.cameras)
        return prepare(photos.photos, self._scene(photos), settings, emit=ignore_events, should_stop=never_stop)

    def _scene(self, photos: PhotoSetFolder) -> Path:
        return self.out / "scenes" / photos.name


def engine_state() -> str:
    """Return 12 digits that change with the code that trains: trainings of another state are not reused."""
    digest = hashlib.sha256()
    for file in sorted(file for package in _PACKAGES for file in (ROOT / "engine" / package).rglob("*.py")):
        digest.update(file.relative_to(ROOT).as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:12]
