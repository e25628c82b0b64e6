"""The facts of the report, gathered from what the stages stored, as JSON values. Nothing is measured here."""

from __future__ import annotations

from typing import Any

from ...core.errors import FormatError
from ...core.files import Schema, check, optional
from ...core.settings import to_dict
from ...project.folder import PROJECT_FILE, ProjectFolder
from ...project.objects import list_objects
from ..records import describe_scene, scene_title

REPORT_VERSION = 1
STAGES = ("photos", "cameras", "masks", "training", "objects")
_NUMBER = optional((float, None))
_FIGURES: dict[str, Schema] = {
    "photos": {"n_photos": _NUMBER, "rejected": optional([{"name": str, "reason": str}])},
    "cameras": {
        "n_registered": _NUMBER,
        "unregistered": optional([str]),
        "reprojection_error": _NUMBER,
        "poses_given": optional(bool),
        "health": optional(({"colour": str, "sentence": str}, None)),
    },
    "masks": {
        "n_photos": _NUMBER,
        "seconds_per_photo": _NUMBER,
        "beside": optional({"seconds": float, "peak_memory": (float, None)}),
    },
    "training": {
        "curve": optional([{str: (float, None)}]),
        "held_out": optional(([str], None)),
        "measured_photos": optional(([str], None)),
        "validation_photos": optional(([str], None)),
        "preset": optional((str, None)),
        "device": optional((str, None)),
        "guards": optional({str: float}),
        "limits": optional({str: float}),
        "trials": optional([{"what": str, "step": int, "n_steps": int, "gain": (float, None), "kept": bool}]),
        "stopped_early": optional(
            (dict.fromkeys(("planned_steps", "expected_gain", "limit", "wall_seconds_saved"), float), None)
        ),
        "feature_agreement": optional(({str: (float, None)}, None)),
        **dict.fromkeys(("steps", "n_gaussians", "step_ms", "sh_degree"), _NUMBER),
        **dict.fromkeys(("fitted_psnr", "well_seen_psnr", "well_seen_share", "dark_share"), _NUMBER),
    },
    "objects": {"refused": optional({str: str})},
}
"""Types of the figures of each stage, as far as the report shows them."""
_VALUES: dict[str, Schema] = {
    "work_plan": {
        "pairs": str,
        "features": bool,
        "device": optional({"name": str, "reason": str}),
        **dict.fromkeys(("width", "height", "n_pairs", "n_mask_photos", "max_gaussians", "sh_degree", "steps"), int),
    },
    "measured_savings": {str: {"training_cpu_seconds": float, "psnr_lost": float, "mask_cpu_seconds": optional(float)}},
}
"""The same for values of ``project.json`` that no stage records and `engine.project.versions` does not check."""


def collect_facts(project: ProjectFolder, *, title: str | None = None) -> dict[str, Any]:
    """Return the facts of the report as JSON values.

    Parameters
    ----------
    project : ProjectFolder
        In any state; a stage that is not done gives an empty part.
    title : str, optional
        Of the scene; by default its photos' folder names it.

    Returns
    -------
    dict
        ``stages`` (name, wall and CPU seconds), ``photos``, ``cameras``, ``masks``, ``training``, ``objects``,
        ``refused_prompts``, ``plan``, ``forecast`` (per stage, with the actual cost), ``left_out``,
        ``measured_savings`` and ``record`` (see `describe_scene`: when, with what and from what it was made).

    Raises
    ------
    FormatError
        When a part of ``project.json`` that the report shows is damaged.
    """
    _require_figures(project)
    records = {stage: project.stage_record(stage) for stage in STAGES}
    figures = {stage: (record or {}).get("figures") or {} for stage, record in records.items()}
    plan = project.get("plan") or {}
    training = dict(figures["training"])
    if training:
        training["step_ms"] = _step_ms(training)
    return {
        "version": REPORT_VERSION,
        "title": title or scene_title(project),
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
        "objects": [_without_settings(to_dict(record)) for record in list_objects(project.path)],
        "refused_prompts": figures["objects"].get("refused", {}),
        "plan": project.get("work_plan") or {},
        "forecast": _forecast(project.get("forecast"), records),
        "left_out": [
            *(dict(item) for item in plan.get("left_out", ())),
            *_rejected_by_trials(training),
            *_steps_left_out(training),
        ],
        "measured_savings": (project.get("measured_savings") or {}).get(str(training.get("preset"))),
        "record": describe_scene(project, title=title),
    }


def _require_figures(project: ProjectFolder) -> None:
    """Raise `FormatError` unless what the report shows of ``project.json`` has the types that it needs."""
    problem = None
    for stage, schema in _FIGURES.items():
        record = project.stage_record(stage)
        problem = problem or (record and check(record["figures"], schema, f"stages.{stage}.figures"))
    for name, schema in _VALUES.items():
        problem = problem or check(project.get(name), (schema, None), name)
    if problem:
        raise FormatError(
            f"{project.path / PROJECT_FILE} cannot be read: {problem}. Run `reconstruct` in a new folder, or ask "
            "whoever made the project for an undamaged copy."
        )


def _forecast(forecast: dict[str, Any] | None, records: dict[str, dict[str, Any] | None]) -> list[dict[str, Any]]:
    """Return the forecast and the actual cost of each stage of the plan; None where the cost is unknown."""
    rows = []
    for expected in (forecast or {}).get("stages", ()):
        record = records.get(expected["stage"]) or {}
        beside = record.get("figures", {}).get("beside") or {}
        rows.append(
            {
                **{name: expected[name] for name in ("stage", "seconds", "low", "high")},
                **{name: expected[name] for name in ("memory", "memory_low", "memory_high")},
                "actual_seconds": record.get("wall_seconds"),
                "actual_memory": beside.get("peak_memory") or record.get("peak_memory"),
                "continued": bool(record.get("continued")),
                "beside_seconds": beside.get("seconds"),
            }
        )
    return rows


def _rejected_by_trials(training: dict[str, Any]) -> list[dict[str, Any]]:
    """Return what trials rejected, with its effect on the validation photos."""
    return [
        {
            "what": "the brightness correction per photo"
            if trial["what"] == "exposure"
            else f"bands of view-dependent colour above {_band_below(trial['what'])}",
            "why": f"{trial['n_steps']} steps with and without, from step {trial['step']:,} on: "
            f"{trial['gain']:+.2f} dB on the validation photos",
        }
        for trial in training.get("trials", ())
        if not trial["kept"] and trial["gain"] is not None
    ]


def _band_below(band: str) -> str:
    return str(int(band) - 1) if band.isascii() and band.isdecimal() and len(band) < 3 else f"the one below {band}"


def _steps_left_out(training: dict[str, Any]) -> list[dict[str, Any]]:
    stopped = training.get("stopped_early")
    if not stopped or training.get("steps") is None:
        return []
    planned = stopped["planned_steps"]
    return [
        {
            "what": f"{planned - training['steps']:,} of {planned:,} training steps",
            "why": f"stopped at step {training['steps']:,}: the curve is flat, and the remaining steps would "
            f"have gained about {max(0.0, stopped['expected_gain']):.2f} dB, less than {stopped['limit']:g}",
            "saved": f"about {stopped['wall_seconds_saved']:.0f} s, from the speed of the last steps",
        }
    ]


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
