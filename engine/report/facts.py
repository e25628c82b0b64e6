"""What the stages stored, gathered into plain JSON values for the report. Nothing is measured here."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import PurePath
from typing import Any

from .. import __version__
from ..objects.storage import list_objects
from ..project_folder import ProjectFolder

__all__ = ["REPORT_VERSION", "STAGES", "collect_facts"]

REPORT_VERSION = 1
STAGES = ("photos", "cameras", "masks", "training", "objects")
_PACKAGES = (
    "torch",
    "numpy",
    "numba",
    "pycolmap",
    "onnxruntime",
    "opencv-contrib-python-headless",
    "scipy",
    "Pillow",
)


def collect_facts(project: ProjectFolder) -> dict[str, Any]:
    """Return everything the report says, as JSON values.

    Parameters
    ----------
    project : ProjectFolder
        In any state: a stage that was left out or is not done gives an empty part.

    Returns
    -------
    dict
        ``stages`` (name, wall and CPU seconds), ``photos``, ``cameras``, ``masks``, ``training``, ``objects``,
        ``refused_prompts``, ``left_out``, ``software`` and ``machine``.
    """
    records = {stage: project.stage_record(stage) for stage in STAGES}
    figures = {stage: (record or {}).get("figures") or {} for stage, record in records.items()}
    plan = project.get("plan") or {}
    training = dict(figures["training"])
    if training:
        training["step_ms"] = _step_ms(training)
    return {
        "version": REPORT_VERSION,
        "title": _title(project),
        "stages": [
            {"stage": stage, "wall_seconds": record["wall_seconds"], "cpu_seconds": record["cpu_seconds"]}
            for stage, record in records.items()
            if record is not None
        ],
        "not_done": [stage for stage, record in records.items() if record is None],
        "photos": figures["photos"],
        "cameras": figures["cameras"],
        "masks": figures["masks"],
        "training": training,
        "objects": [_without_settings(asdict(record)) for record in list_objects(project.path)],
        "refused_prompts": figures["objects"].get("refused", {}),
        "left_out": [dict(item) for item in plan.get("left_out", ())],
        "software": {
            "gaussian heritage": __version__,
            "python": platform.python_version(),
            **_versions(_PACKAGES),
        },
        "machine": {
            "system": platform.system(),
            "processor": platform.machine(),
            "cores": _cores(),
        },
    }


def _title(project: ProjectFolder) -> str:
    """Return the photo folder's name, or that of the project where photos lie in a folder called just that."""
    photos = PurePath(str(project.get("photo_folder") or ""))
    generic = ("", "photos", "images", "pictures", "fotos", "dcim")
    return photos.name if photos.name.lower() not in generic else project.path.resolve().name


def _without_settings(record: dict[str, Any]) -> dict[str, Any]:
    settings = record.pop("settings")
    record["method"] = {key: settings.get(key) for key in ("cosine", "refinement", "completion") if key in settings}
    return record


def _step_ms(training: dict[str, Any]) -> float | None:
    if training.get("step_ms") is not None:
        return float(training["step_ms"])
    curve = training.get("curve") or []
    if curve and curve[-1].get("step"):
        return 1000.0 * float(curve[-1]["wall_seconds"]) / float(curve[-1]["step"])
    return None


def _versions(names: Iterable[str]) -> dict[str, str]:
    versions = {}
    for name in names:
        try:
            versions[name.lower()] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return versions


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
