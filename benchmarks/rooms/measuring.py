"""Measures a trained room with the method of this working tree: by mask, by click, by word, and find all."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from engine.core.errors import ProjectError
from engine.core.events import Emit, StopCheck
from engine.core.files import finite_or_null, read_json, write_json
from engine.core.system import cpu_seconds, describe_machine
from engine.masks import load_default_sam
from engine.objects import DetectorFactory, SamFactory
from engine.objects.grounding import load_default_detector
from engine.project.folder import ProjectFolder, stage_key
from engine.quality.evaluation import evaluate_project
from engine.quality.evaluation.results import Evaluation, Row, Word
from engine.quality.evaluation.settings import EvaluationSettings, PromptKind

from .results import METHODS, VERSION

_STAGES = ("photos", "cameras", "masks", "training")
_KINDS: tuple[PromptKind, ...] = ("mask", "click", "text", "all")
_TEST_PHOTOS = "test photos"


def measure_project(
    folder: Path,
    truth: Path,
    out: Path,
    *,
    detector_factory: DetectorFactory = load_default_detector,
    sam_factory: SamFactory = load_default_sam,
    emit: Emit,
    should_stop: StopCheck,
) -> None:
    """Measure a project and write the figures.

    Parameters
    ----------
    folder : Path
        Trained project; only read.
    truth : Path
        Folder with the ground truth.
    out : Path
        JSON file, see `benchmarks.rooms.results`. What is measured for one kind of prompt is kept in a file beside it,
        so that a killed run does not measure it again.
    detector_factory, sam_factory : callable
        Called when their model is first needed.
    emit, should_stop
        See `engine.core.events`.

    Raises
    ------
    ProjectError
        When the project is not trained.
    HeritageError
        As `engine.quality.evaluation.evaluate_project`.
    """
    project = ProjectFolder.open_existing(folder)
    training = project.stage_record("training")
    if training is None:
        raise ProjectError(f"{folder} is not trained. Run `python -m benchmarks.rooms reconstruct` first.")
    project.require_intact(*_STAGES)
    machine = describe_machine()
    figures = training["figures"]
    data: dict[str, Any] = {
        "version": VERSION,
        "machine": {"cores": machine.cores, "system": f"{platform.system()} {platform.machine()}"},
        "n_gaussians": figures["n_gaussians"],
        "test_photos": figures["held_out"],
        "test_psnr": figures["psnr"] if figures["measured_on"] == _TEST_PHOTOS else None,
        "seconds": {stage: _stage_seconds(project, stage) for stage in _STAGES},
    }
    key = stage_key(training["key"], project.recorded_outputs("training"))
    for kind in _KINDS:

        def evaluate(kind: PromptKind = kind) -> Evaluation:
            settings = EvaluationSettings(presets=METHODS, prompt_kind=kind)
            return evaluate_project(
                project, truth, settings, detector_factory=detector_factory, sam_factory=sam_factory, emit=emit,
                should_stop=should_stop,
            )  # fmt: skip

        part = _kept(out.with_name(f"{out.stem}-{kind}.json"), key, evaluate)
        data |= part["figures"]
        data["seconds"][f"by {kind}" if kind != "all" else "find all"] = part["seconds"]
    write_json(out, data)


def _stage_seconds(project: ProjectFolder, stage: str) -> dict[str, Any]:
    record = project.stage_record(stage)
    if record is None:
        raise ProjectError(
            f"{project.path} lacks the stage {stage!r}. Run `make test-rooms` again, which continues it."
        )
    return {"wall": record["wall_seconds"], "cpu": record["cpu_seconds"], "whole": not record.get("continued", False)}


def _kept(file: Path, key: str, evaluate: Callable[[], Evaluation]) -> dict[str, Any]:
    """Return the figures and seconds of one kind of prompt, measured unless `file` has them of the same training."""
    schema = {"key": str, "figures": dict, "seconds": dict}
    if file.exists():
        kept: dict[str, Any] = read_json(file, schema, advice="Delete it, then run again.")
        if kept["key"] == key:
            return kept
    wall, cpu = time.perf_counter(), cpu_seconds()
    figures = _figures(evaluate())
    seconds = {"wall": time.perf_counter() - wall, "cpu": cpu_seconds() - cpu, "whole": True}
    part = {"key": key, "figures": finite_or_null(figures), "seconds": seconds}
    write_json(file, part)
    return part


def _figures(evaluation: Evaluation) -> dict[str, Any]:
    kind = evaluation.settings.prompt_kind
    if kind in ("mask", "click"):
        rows = {method: [row for row in evaluation.rows if row.method == method] for method in METHODS}
        return {kind: {method: [_object(row) for row in found] for method, found in rows.items()}}
    if kind == "text":
        return {
            "text": {
                method: _words([word for word in evaluation.words if word.method == method]) for method in METHODS
            },
            "ceiling": None if evaluation.ceiling is None else dict(evaluation.ceiling),
        }
    return {
        "all": {
            search.method: {
                "objects": [_object(row) for row in evaluation.rows if row.method == search.method],
                "n_false": sum(result.kind == "false" for result in search.results),
                "n_results": len(search.results),
                "wall": search.seconds,
                "cpu": search.cpu_seconds,
            }
            for search in evaluation.searches
        }
    }


def _object(row: Row) -> dict[str, Any]:
    return {"object": row.object, "iou": _short(row.iou), "boundary_iou": _short(row.boundary_iou)}


def _words(words: Sequence[Word]) -> dict[str, Any]:
    shown = [{"word": word.prompt, "iou": _short(word.iou), **_answer(word)} for word in words if not word.absent]
    return {"words": shown, "absent": [{"word": word.prompt, **_answer(word)} for word in words if word.absent]}


def _answer(word: Word) -> dict[str, Any]:
    return {"refused": word.n_results == 0, "wall": round(word.seconds, 2), "cpu": round(word.cpu_seconds, 2)}


def _short(value: float) -> float:
    return round(value, 4)
