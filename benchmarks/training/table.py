"""The table of presets beside gsplat."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence

from .reference import GSPLAT, GSPLAT_FITTED
from .running import Measured

Results = Mapping[tuple[str, str], Sequence[Measured]]
"""Figures by set and preset, one for each seed."""


def presets_table(results: Results) -> str:
    """Return a row for each set and preset: means over the seeds, beside what gsplat reaches on the set."""
    lines = [
        "| set | preset | steps | Gaussians | test PSNR dB | fitted | SSIM | wall s | CPU s | gsplat dB | fitted |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for (name, preset), found in results.items():
        cells = [
            name, f"`{preset}`", f"{_mean(found, 'steps'):,.0f}", f"{_mean(found, 'n_gaussians'):,.0f}",
            f"{_mean(found, 'psnr'):.2f}", f"{_mean(found, 'fitted_psnr'):.2f}", f"{_mean(found, 'ssim'):.3f}",
            f"{_mean(found, 'wall_seconds'):.0f}", f"{_mean(found, 'cpu_seconds'):.0f}",
            _decibels(GSPLAT.get(name)), _decibels(GSPLAT_FITTED.get(name)),
        ]  # fmt: skip
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _decibels(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def _mean(found: Sequence[Measured], figure: str) -> float:
    return statistics.mean(getattr(measured, figure) for measured in found)
