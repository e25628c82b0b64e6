"""Errors in views that no photo has, the share of needles, and the table of both."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine.rasterizer.settings import Backend
from engine.scene import Gaussians
from engine.training import Parameters, TrainingView
from engine.training.held_out import image_quality, render_picture
from engine.training.settings import FeatureSettings
from engine.training.trials import brightness_factors
from engine.training.views import ViewPyramid

OFF_PATH = "off the path"
"""Name of the table in a document."""
KINDS = ("near", "far", "above")
"""What the names of views begin with: half the distance of a photo, one and a half times, and 20 degrees higher."""

_NEEDLE = 5.0
"""A Gaussian is a needle if it is longer than so many times its middle axis."""
_VISIBLE = 0.05
"""Gaussians of a lower opacity are not counted."""


@dataclass(frozen=True)
class OffPath:
    """PSNR in dB of views of each of `KINDS`, with the brightness of each picture fitted, and their mean."""

    near: float
    far: float
    above: float

    @property
    def mean(self) -> float:
        """Mean of the kinds."""
        return (self.near + self.far + self.above) / 3


def off_path_figures(gaussians: Gaussians, views: Sequence[TrainingView], *, backend: Backend = "cpu") -> OffPath:
    """Return the PSNR of Gaussians in the valid pixels of some views, which are those that enough photos determine.

    Parameters
    ----------
    gaussians : Gaussians
    views : sequence of TrainingView
        From `off_path_views.true_views`.
    backend : {"cpu", "gpu"}
    """
    values = Parameters.from_gaussians(gaussians, sh_degree=gaussians.sh_degree, features=False).values
    pyramid = ViewPyramid(views, FeatureSettings())
    found: dict[str, list[float]] = {kind: [] for kind in KINDS}
    for number, view in enumerate(views):
        level = pyramid.level(number, 0)
        picture = render_picture(values, level, backend=backend, sh_degree=gaussians.sh_degree)
        fitted = picture * brightness_factors(picture, level)
        if level.valid is None or level.valid.any():
            found[view.photo.split("_")[0]].append(image_quality(fitted, level.pixels, level.valid).psnr)
    return OffPath(*(float(np.mean(found[kind])) if found[kind] else float("nan") for kind in KINDS))


def needles(gaussians: Gaussians) -> float:
    """Return the share of visible Gaussians longer than five times their middle axis, in percent."""
    ordered = np.sort(gaussians.log_scales[gaussians.opacity_logits > np.log(_VISIBLE / (1 - _VISIBLE))], axis=1)
    return 100 * float((ordered[:, 2] - ordered[:, 1] > np.log(_NEEDLE)).mean())


def off_path_table(results: Sequence[dict[str, Any]]) -> str:
    """Return the table of trainings measured off the path: means over the rooms and seeds of each run.

    Parameters
    ----------
    results : sequence of dict
        ``set``, ``run``, ``seed`` and ``figures`` of each training; those not measured off the path are left out.
    """
    found: dict[str, list[dict[str, Any]]] = {}
    for result in results:
        if "off_path" in result["figures"]:
            found.setdefault(result["run"], []).append(result)
    lines = [
        f"| run | rooms | seeds | test photos | {' | '.join(KINDS)} | mean off the path | needles % |",
        "| --- |" + " ---: |" * (5 + len(KINDS)),
    ]
    for run, rows in found.items():
        figures = [row["figures"] for row in rows]
        kinds = [statistics.mean(one["off_path"][kind] for one in figures) for kind in KINDS]
        psnr, share = (statistics.mean(one[name] for one in figures) for name in ("psnr", "needles"))
        cells = [f"{value:.2f}" for value in (psnr, *kinds, statistics.mean(kinds))]
        counts = [str(len({row[name] for row in rows})) for name in ("set", "seed")]
        lines.append(f"| {run} | {' | '.join(counts)} | {' | '.join(cells)} | {share:.0f} |")
    return "\n".join(lines)
