"""The plan and its forecast in words, for the person at the screen."""

from __future__ import annotations

from ..masks.settings import EMBEDDING_BYTES, MOST_EMBEDDINGS
from .decisions import WorkPlan
from .forecast import Forecast

__all__ = ["plan_in_words"]


def plan_in_words(work: WorkPlan, forecast: Forecast) -> str:
    """Return the plan as lines of text."""
    lines = [
        f"{work.n_photos} photos, the largest {work.photo_width} x {work.photo_height}; preset {work.preset}",
        "",
        *(f"  {name:<12}{value}" for name, value in decisions_in_words(work)),
        "",
        *_table(forecast),
    ]
    lines += ["", "Left out:"] + [f"  {item.what}: {item.why}" for item in work.left_out]
    lines += ["", *work.notes] if work.notes else []
    return "\n".join(lines)


def decisions_in_words(work: WorkPlan) -> list[tuple[str, str]]:
    """Return what is done, as pairs of a name and a sentence."""
    every = work.n_photos * (work.n_photos - 1) // 2
    pairs = {
        "none": "given, no photo is matched",
        "all": f"every pair of photos is matched: {work.n_pairs:,}",
        "promising": f"about {work.n_pairs:,} of {every:,} pairs are matched, those that a quick look finds promising",
    }[work.pairs]
    kept = min(work.n_mask_photos, MOST_EMBEDDINGS) * EMBEDDING_BYTES / 1e6
    masks = (
        f"{work.n_mask_photos} photos, chosen once the cameras are known; {kept:.0f} MB on disk for quick clicks later"
    )
    held_out = f"{work.n_held_out} photos measure the error, named once the cameras are known"
    flat = f", fewer when they would gain less than {work.stop_when_flat} dB" if work.stop_when_flat else ""
    if_it_pays = ", if a trial shows that it pays" if work.trial and work.n_held_out else ""
    bands = f"colour bands up to degree {work.sh_degree}{if_it_pays if work.sh_degree else ''}"
    return [
        ("cameras", pairs),
        ("masks", masks if work.n_mask_photos else "none"),
        ("pictures", f"{work.width} x {work.height} pixels for training"),
        ("Gaussians", f"at most {work.max_gaussians:,}, {bands}"),
        ("features", "16 numbers a Gaussian, trained together with the colour" if work.features else "none"),
        ("exposure", f"one brightness correction a photo{if_it_pays}" if work.exposure else "no correction"),
        ("steps", f"{work.steps:,}{flat}"),
        ("held out", held_out if work.n_held_out else "none"),
    ]


def _table(forecast: Forecast) -> list[str]:
    lines = [f"  {'stage':<12}{'minutes (8 of 10 runs)':<28}memory"]
    for stage in forecast.stages:
        minutes = f"{stage.seconds / 60:.1f} ({stage.low / 60:.1f} to {stage.high / 60:.1f})"
        memory = f"{stage.memory / 1e9:.1f} GB ({stage.memory_low / 1e9:.1f} to {stage.memory_high / 1e9:.1f})"
        lines.append(f"  {stage.stage:<12}{minutes:<28}{memory}")
    low, middle, high = (seconds / 60 for seconds in forecast.seconds)
    lines.append(f"  {'together':<12}{f'{middle:.1f} ({low:.1f} to {high:.1f})':<28}{_free(forecast)}")
    learned = f"{forecast.n_runs} earlier runs" if forecast.n_runs != 1 else "one earlier run"
    basis = f"a short benchmark and {learned}" if forecast.n_runs else "a short benchmark; every run makes it better"
    lines.append(f"  on {forecast.cores} cores that do nothing else, from {basis}")
    return lines


def _free(forecast: Forecast) -> str:
    if forecast.free_memory is None:
        return "this system does not say how much memory is free: not checked"
    return f"{forecast.free_memory / 1e9:.1f} GB are free"
