"""Tables of trainings: presets beside gsplat, and variants over photo sets."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence

from .reference import GSPLAT, GSPLAT_FITTED
from .running import Measured

Results = Mapping[tuple[str, str, str], Sequence[Measured]]
"""Figures by set, preset and variant, one for each seed."""


def presets_table(results: Results) -> str:
    """Return a row for each set and preset: means over the seeds, beside what gsplat reaches on the set."""
    lines = [
        "| set | preset | steps | Gaussians | test PSNR dB | fitted | SSIM | wall s | CPU s | gsplat dB | fitted |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for (name, preset, _), found in results.items():
        cells = [
            name, f"`{preset}`", f"{_mean(found, 'steps'):,.0f}", f"{_mean(found, 'n_gaussians'):,.0f}",
            f"{_mean(found, 'psnr'):.2f}", f"{_mean(found, 'fitted_psnr'):.2f}", f"{_mean(found, 'ssim'):.3f}",
            f"{_mean(found, 'wall_seconds'):.0f}", f"{_mean(found, 'cpu_seconds'):.0f}",
            _decibels(GSPLAT.get(name)), _decibels(GSPLAT_FITTED.get(name)),
        ]  # fmt: skip
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def variants_table(results: Results) -> str:
    """Return mean PSNR on test photos: a row per variant, a column per set, and the mean change to the first variant.

    In brackets with the brightness of each picture fitted to its photo. The change is over the sets that both have.
    """
    by_variant: dict[str, dict[str, Sequence[Measured]]] = {}
    for (name, _, variant), found in results.items():
        by_variant.setdefault(variant, {})[name] = found
    sets = list(dict.fromkeys(name for name, _, _ in results))
    lines = [
        f"| PSNR dB (fitted) | {' | '.join(sets)} | mean change |",
        f"| --- |{' ---: |' * (len(sets) + 1)}",
    ]
    base = next(iter(by_variant.values()))
    for variant, row in by_variant.items():
        cells = [
            _cell(_mean(row[name], "psnr"), _mean(row[name], "fitted_psnr")) if name in row else "" for name in sets
        ]
        both = [name for name in sets if name in row and name in base]
        change = ""
        if row is not base and both:
            change = _cell(*(
                statistics.mean(_mean(row[name], figure) - _mean(base[name], figure) for name in both)
                for figure in ("psnr", "fitted_psnr")
            ), sign="+")  # fmt: skip
        lines.append(f"| {variant} | {' | '.join(cells)} | {change} |")
    return "\n".join(lines)


def _cell(psnr: float, fitted: float, *, sign: str = "") -> str:
    return f"{psnr:{sign}.2f} ({fitted:{sign}.2f})"


def _decibels(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def _mean(found: Sequence[Measured], figure: str) -> float:
    return statistics.mean(getattr(measured, figure) for measured in found)
