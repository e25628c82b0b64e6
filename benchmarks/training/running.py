"""One training of a preset on a photo set, measured; finished ones are kept for as long as the engine is unchanged."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from engine.cameras.settings import CameraSettings
from engine.core.events import ignore_events, never_stop
from engine.core.files import read_json, write_json
from engine.pipeline.planning import PlanSettings, WorkPlan, plan_scene, plan_work, training_settings
from engine.pipeline.reconstruct import PipelineSettings
from engine.quality.bench.prepared import PreparedScene, prepare, prepare_masks, read_prepared, train_prepared
from engine.scene import CameraSet
from engine.training import load_gaussians, measure_quality
from engine.training.settings import PRESETS

from .photo_sets import ROOT, PhotoSetFolder

MEASURED_SIDE = PRESETS["standard"].schedule.max_side
"""Longest side of the pictures that every training is measured on, pixels."""

_FIGURES = "measured.json"
_SCHEMA = {"figures": dict}
_PARTS = ("cameras", "masks", "photos", "pipeline/planning", "rasterizer", "scene", "training")
"""Folders of the engine whose code decides what a training gives."""


@dataclass(frozen=True)
class Measured:
    """Figures of one training, on test photos.

    Attributes
    ----------
    psnr, fitted_psnr, ssim : float
        Of pictures of `MEASURED_SIDE`; `fitted_psnr` with the brightness of each picture fitted to its photo.
    steps, n_gaussians : int
    wall_seconds, cpu_seconds : float
        Of training, without measurements.
    curve : list of dict
        `engine.training.held_out.CurvePoint`, measured during training at the preset's own picture size.
    """

    psnr: float
    fitted_psnr: float
    ssim: float
    steps: int
    n_gaussians: int
    wall_seconds: float
    cpu_seconds: float
    curve: list[dict[str, float]]


class TrainingBench:
    """Trains and measures presets.

    Parameters
    ----------
    out : Path
        Cameras and masks of each set are kept in ``scenes``, trainings in a folder for the state of the engine.
    """

    def __init__(self, out: Path) -> None:
        self.out = out
        self._runs = out / engine_state()
        self._prepared: dict[str, PreparedScene] = {}

    def measured(self, photos: PhotoSetFolder, preset: str, seed: int) -> Measured:
        """Return the figures of a training; one that was measured before is not repeated.

        Raises
        ------
        HeritageError
            As the stages of the pipeline.
        """
        stored = self.stored(photos, preset, seed)
        if stored is not None:
            return stored
        folder = self.folder(photos, preset, seed)
        measured = self._measure(photos, preset, seed, folder)
        write_json(folder / _FIGURES, {"figures": asdict(measured)})
        return measured

    def stored(self, photos: PhotoSetFolder, preset: str, seed: int) -> Measured | None:
        """Return the figures of a training that was measured before, else None.

        Raises
        ------
        FormatError
            When their file is damaged.
        """
        file = self.folder(photos, preset, seed) / _FIGURES
        if not file.exists():
            return None
        return Measured(**read_json(file, _SCHEMA, advice="Delete it, then run again.")["figures"])

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
        if photos.project is not None:
            return self._with_cameras(photos)
        if photos.name not in self._prepared:
            prepared, scene = self._with_cameras(photos), self._scene(photos)
            work = self._plan(photos, prepared, PlanSettings())
            self._prepared[photos.name], _ = prepare_masks(
                prepared, scene, work, PipelineSettings(), emit=ignore_events, should_stop=never_stop
            )
        return self._prepared[photos.name]

    def folder(self, photos: PhotoSetFolder, preset: str, seed: int) -> Path:
        """Return the project folder of a training."""
        return self._runs / photos.name / f"{preset}-{seed}"

    def _measure(self, photos: PhotoSetFolder, preset: str, seed: int, folder: Path) -> Measured:
        prepared = self.prepared(photos)
        work = self._plan(photos, prepared, PlanSettings(preset=preset))
        training = training_settings(work).changed(seed=seed)
        project = train_prepared(prepared, folder, work, training, emit=ignore_events, should_stop=never_stop)
        figures: dict[str, Any] = (project.stage_record("training") or {})["figures"]
        held_out = plan_scene(work, prepared.camera_set).held_out
        registered = [camera.photo for camera in prepared.camera_set.cameras]
        test = measure_quality(
            load_gaussians(folder / "gaussians"), photos.photos, prepared.camera_set, held_out,
            trained=[name for name in registered if name not in held_out], max_side=MEASURED_SIDE,
            should_stop=never_stop,
        )  # fmt: skip
        return Measured(
            test.quality.psnr, test.fitted.psnr, test.quality.ssim, figures["steps"], figures["n_gaussians"],
            figures["wall_seconds"], figures["cpu_seconds"], figures["curve"],
        )  # fmt: skip

    def _plan(self, photos: PhotoSetFolder, prepared: PreparedScene, settings: PlanSettings) -> WorkPlan:
        given = photos.project is not None
        return plan_work(
            prepared.photo_set, prepared.statistics, settings, cameras=CameraSettings(), poses_given=given,
            points_given=given,
        )  # fmt: skip

    def _with_cameras(self, photos: PhotoSetFolder) -> PreparedScene:
        """Return photos and cameras of a set, and the masks of a kept room."""
        if photos.project is not None:
            return read_prepared(photos.project, never_stop)
        return prepare(
            photos.photos, self._scene(photos), PipelineSettings(), emit=ignore_events, should_stop=never_stop
        )

    def _scene(self, photos: PhotoSetFolder) -> Path:
        return self.out / "scenes" / photos.name


def engine_state() -> str:
    """Return 12 digits that change with the code that trains: trainings of another state are not reused."""
    digest = hashlib.sha256()
    for file in sorted(file for part in _PARTS for file in (ROOT / "engine" / part).rglob("*.py")):
        digest.update(file.relative_to(ROOT).as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:12]
