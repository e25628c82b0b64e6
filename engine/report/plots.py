"""Curves of the report as SVG."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import Any

__all__ = ["error_curve"]

_INK, _LINE, _QUIET = "#2b2a27", "#8a4b2a", "#3f6673"


def error_curve(curve: Sequence[dict[str, Any]]) -> str:
    """Return held-out PSNR, SSIM and L1 against wall and CPU seconds as one SVG element.

    Parameters
    ----------
    curve : sequence of dict
        ``wall_seconds``, ``cpu_seconds``, ``psnr``, ``ssim`` and ``l1`` of each measurement. Points that were not
        measured or are not finite are left out.

    Returns
    -------
    str
        ``<svg ...>...</svg>``; empty when there are fewer than two points.
    """
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter

    points = [point for point in curve if _finite(point, "wall_seconds") and float(point["wall_seconds"]) > 0]
    if len(points) < 2:
        return ""
    figure = Figure(figsize=(9.6, 2.9), layout="constrained")
    FigureCanvasSVG(figure)
    panels = (
        ("psnr", "PSNR, dB (higher is better)"),
        ("ssim", "SSIM (higher is better)"),
        ("l1", "L1 (lower is better)"),
    )
    for axes, (key, title) in zip(figure.subplots(1, 3), panels, strict=True):
        for time, style, color in (("wall_seconds", "-", _LINE), ("cpu_seconds", "--", _QUIET)):
            usable = [p for p in points if _finite(p, key) and _finite(p, time)]
            axes.plot(
                [p[time] for p in usable],
                [p[key] for p in usable],
                style,
                color=color,
                marker="o",
                markersize=3,
                linewidth=1.4,
                label="wall time" if time == "wall_seconds" else "CPU time",
            )
        axes.set_title(title, fontsize=9, color=_INK, loc="left")
        axes.set_xlabel("seconds", fontsize=8, color=_INK)
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.grid(alpha=0.25, linewidth=0.6)
        axes.tick_params(labelsize=8, colors=_INK)
        axes.spines[["top", "right"]].set_visible(False)
        axes.patch.set_alpha(0)
    figure.axes[0].legend(fontsize=8, frameon=False)
    figure.patch.set_alpha(0)
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def _finite(point: dict[str, Any], key: str) -> bool:
    value = point.get(key)
    return isinstance(value, int | float) and math.isfinite(value)
