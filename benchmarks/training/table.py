"""Tables of variants over photo sets."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence

from .reference import BEFORE, GSPLAT, GSPLAT_FITTED
from .running import Measured

Results = Mapping[tuple[str, str], Sequence[Measured]]
"""Figures by set and variant, one for each seed."""


def overview(results: Results) -> str:
    """Return the table of mean PSNR on test photos: a column per set, and the means over all sets that a row has.

    In brackets with the brightness of each picture fitted to its photo.
    """
    sets, variants = list(dict.fromkeys(s for s, _ in results)), list(dict.fromkeys(v for _, v in results))
    lines = [
        f"| PSNR dB (fitted) | {' | '.join(sets)} | mean change |",
        f"| --- |{' ---: |' * (len(sets) + 1)}",
    ]
    first = variants[0]
    for variant in variants:
        runs = [results.get((name, variant), ()) for name in sets]
        cells = [_cell(_mean(run, "psnr"), _mean(run, "fitted_psnr")) if run else "" for run in runs]
        change = ""
        if variant != first:
            base = [results.get((name, first), ()) for name in sets]
            pairs = [(run, other) for run, other in zip(runs, base, strict=True) if run and other]
            if pairs:
                change = _cell(*(_mean_change(pairs, figure) for figure in ("psnr", "fitted_psnr")), sign="+")
        lines.append(f"| {variant} | {' | '.join(cells)} | {change} |")
    for title, psnr, fitted in (
        ("commit 06f55961, as planned", BEFORE, {}), ("gsplat, 3,000 steps", GSPLAT, GSPLAT_FITTED),
    ):  # fmt: skip
        cells = [_cell(psnr[name], fitted.get(name)) if name in psnr else "" for name in sets]
        lines.append(f"| {title} | {' | '.join(cells)} | |")
    return "\n".join(lines)


def _mean_change(pairs: Sequence[tuple[Sequence[Measured], Sequence[Measured]]], figure: str) -> float:
    return statistics.mean(_mean(run, figure) - _mean(base, figure) for run, base in pairs)


def _cell(psnr: float, fitted: float | None, *, sign: str = "") -> str:
    return f"{psnr:{sign}.2f}" + ("" if fitted is None else f" ({fitted:{sign}.2f})")


def details(results: Results) -> str:
    """Return the table of all figures, a row per set and variant, means over the seeds."""
    lines = [
        "| set | variant | seeds | steps | PSNR dB | fitted | well seen | trained | SSIM | FLIP | dark % "
        "| dark % trained | objects mIoU % | CPU s |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for (name, variant), found in results.items():
        well_seen = [measured.well_seen_psnr for measured in found if measured.well_seen_psnr is not None]
        iou = [measured.iou for measured in found if measured.iou is not None]
        seen = f"{statistics.mean(well_seen):.2f} ({_mean(found, 'well_seen_share'):.0%})" if well_seen else ""
        cells = [
            name, variant, str(len(found)), f"{_mean(found, 'steps'):,.0f}", f"{_mean(found, 'psnr'):.2f}",
            f"{_mean(found, 'fitted_psnr'):.2f}", seen, f"{_mean(found, 'trained_psnr'):.2f}",
            f"{_mean(found, 'ssim'):.3f}", f"{_mean(found, 'flip'):.3f}", f"{100 * _mean(found, 'dark_share'):.2f}",
            f"{100 * _mean(found, 'dark_share_trained'):.2f}", f"{statistics.mean(iou):.1f}" if iou else "",
            f"{_mean(found, 'cpu_seconds'):.0f}",
        ]  # fmt: skip
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _mean(found: Sequence[Measured], figure: str) -> float:
    return statistics.mean(getattr(measured, figure) for measured in found)
