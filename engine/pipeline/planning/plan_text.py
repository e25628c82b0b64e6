"""The plan and its forecast as text for the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from ...masks.settings import EMBEDDING_BYTES, MAX_EMBEDDINGS
from ...rasterizer import device_words
from ...training import validation_photos
from ...training.settings import TrainingPreset
from .decisions import WorkPlan
from .forecast import Forecast


def format_plan(work: WorkPlan, forecast: Forecast) -> str:
    """Return plan and forecast as text of several lines."""
    lines = [
        f"{work.n_photos} photos, the largest {work.photo_width} x {work.photo_height}; preset {work.preset}",
        "",
        *(f"  {name:<12}{value}" for name, value in _decisions(work)),
        "",
        *_forecast_table(forecast),
    ]
    lines += ["", "Left out:"] + [f"  {item.what}: {item.why}" for item in work.left_out]
    lines += ["", *work.notes] if work.notes else []
    return "\n".join(lines)


def format_presets(plans: Sequence[tuple[TrainingPreset, Forecast]]) -> str:
    """Return how long a run with each preset takes, and what it is for, as text of several lines."""
    lines = [f"  {'preset':<12}{'minutes (8 of 10 runs)':<28}what it is for"]
    for preset, forecast in plans:
        low, middle, high = (seconds / 60 for seconds in forecast.seconds)
        lines.append(f"  {preset.name:<12}{f'{middle:.1f} ({low:.1f} to {high:.1f})':<28}{preset.description}")
    return "\n".join(lines)


def _decisions(work: WorkPlan) -> list[tuple[str, str]]:
    """Return the decisions of the plan as pairs of a name and a description."""
    n_all_pairs = work.n_photos * (work.n_photos - 1) // 2
    pairs = {
        "none": "given; no photos are matched",
        "all": f"every pair of photos is matched: {work.n_pairs:,}",
        "promising": f"about {work.n_pairs:,} of {n_all_pairs:,} pairs are matched, selected by a quick comparison",
    }[work.pairs]
    megabytes = min(work.n_mask_photos, MAX_EMBEDDINGS) * EMBEDDING_BYTES / 1e6
    masks = (
        f"{work.n_mask_photos} photos, selected once the cameras are known; "
        f"{megabytes:.0f} MB on disk for quick clicks later"
    )
    test_photos = f"{work.n_held_out}, to measure the error; selected once the cameras are known"
    chooses = bool(validation_photos(work.n_training))
    trial = ", if a trial shows a gain" if work.trial and chooses else ""
    bands = f"colour bands up to degree {work.sh_degree}{trial if work.sh_degree else ''}"
    return [
        ("cameras", pairs),
        ("masks", masks if work.n_mask_photos else "none"),
        ("pictures", f"{work.width} x {work.height} pixels for training"),
        ("Gaussians", f"at most {work.max_gaussians:,}, {bands}"),
        ("features", "16 numbers per Gaussian, trained together with the colour" if work.features else "none"),
        ("exposure", "one brightness correction per photo" if work.exposure else "no correction"),
        ("steps", f"{work.steps:,}"),
        ("training on", _device(work)),
        ("test photos", test_photos if work.n_held_out else "none"),
    ]


def _device(work: WorkPlan) -> str:
    device = work.device
    words = device_words(device.name, device.reason)
    if device.backend == "cpu":
        return words
    of = "" if device.memory is None else f" of its {device.memory / 1e9:.0f} GB"
    return f"{words}, about {device.n_bytes / 1e9:.1f} GB{of} memory"


def _forecast_table(forecast: Forecast) -> list[str]:
    lines = [f"  {'stage':<12}{'minutes (8 of 10 runs)':<28}memory"]
    for stage in forecast.stages:
        minutes = f"{stage.seconds / 60:.1f} ({stage.low / 60:.1f} to {stage.high / 60:.1f})"
        memory = f"{stage.memory / 1e9:.1f} GB ({stage.memory_low / 1e9:.1f} to {stage.memory_high / 1e9:.1f})"
        lines.append(f"  {stage.stage:<12}{minutes:<28}{memory}")
    low, middle, high = (seconds / 60 for seconds in forecast.seconds)
    lines.append(f"  {'together':<12}{f'{middle:.1f} ({low:.1f} to {high:.1f})':<28}{_free_memory(forecast)}")
    if forecast.masks_beside:
        lines.append("  masks are made while the cameras are estimated, as far as a core is idle")
    runs = f"{forecast.n_runs} earlier runs" if forecast.n_runs != 1 else "one earlier run"
    basis = f"a short benchmark and {runs}" if forecast.n_runs else "a short benchmark; every run improves it"
    card = f" and {forecast.device}" if forecast.device != "cpu" else ""
    lines.append(f"  for {forecast.cores} otherwise idle cores{card}, based on {basis}")
    return lines


def _free_memory(forecast: Forecast) -> str:
    if forecast.free_memory is None:
        return "free memory unknown on this system, not checked"
    return f"{forecast.free_memory / 1e9:.1f} GB are free"
