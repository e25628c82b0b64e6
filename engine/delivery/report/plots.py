"""Plots of error against run time: one run as SVG, several runs as PNG."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import Any

from ...core.language import Translate

_INK, _LINE, _QUIET = "#2b2a27", "#8a4b2a", "#3f6673"


def error_curve(curve: Sequence[dict[str, Any]], t: Translate) -> str:
    """Return PSNR, SSIM and L1 on the test photos against wall and CPU seconds as three SVG elements.

    Parameters
    ----------
    curve : sequence of dict
        ``wall_seconds``, ``cpu_seconds``, ``psnr``, ``ssim`` and ``l1`` of each measurement. Values that
        are missing or not finite are left out.
    t : callable
        Translates the labels.

    Returns
    -------
    str
        ``<svg ...>...</svg>`` three times, which a narrow screen shows below each other; empty when there are
        fewer than two points.
    """
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullLocator

    points = [point for point in curve if _finite(point, "wall_seconds") and float(point["wall_seconds"]) > 0]
    if len(points) < 2:
        return ""
    panels = (
        ("psnr", t("PSNR, dB (higher is better)")),
        ("ssim", t("SSIM (higher is better)")),
        ("l1", t("L1 (lower is better)")),
    )
    parts = []
    for key, title in panels:
        figure = Figure(figsize=(3.2, 2.9))
        FigureCanvasSVG(figure)
        # Places that have room for every label: to find them, Matplotlib lays out and draws each plot four times.
        axes = figure.add_axes((0.16, 0.16, 0.81, 0.74))
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
                label=t("wall time" if time == "wall_seconds" else "CPU time"),
            )
        axes.set_title(title, fontsize=9, color=_INK, loc="left", y=1.0)
        axes.set_xlabel(t("seconds"), fontsize=8, color=_INK)
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_locator(NullLocator())
        axes.grid(alpha=0.25, linewidth=0.6)
        axes.tick_params(labelsize=8, colors=_INK)
        axes.spines[["top", "right"]].set_visible(False)
        axes.patch.set_alpha(0)
        if key == "psnr":
            axes.legend(fontsize=8, frameon=False)
        figure.patch.set_alpha(0)
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None})
        text = buffer.getvalue()
        parts.append(text[text.index("<svg") :])
    return "".join(parts)


def compare_curves(
    curves: Sequence[tuple[str, Sequence[dict[str, Any]]]], front: Sequence[tuple[float, float]]
) -> bytes:
    """Return PSNR and L1 on the test photos of several runs against CPU and wall seconds as one PNG picture.

    Parameters
    ----------
    curves : sequence of (str, sequence of dict)
        Name and measurements of each run, as for `error_curve`; runs of one name share a colour.
    front : sequence of (float, float)
        CPU seconds and PSNR of the runs on the Pareto front, all measured at one picture size.

    Returns
    -------
    bytes
        Empty when nothing was measured.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.6, 6.4), layout="constrained")
    FigureCanvasAgg(figure)
    columns = (("cpu_seconds", "CPU seconds"), ("wall_seconds", "wall seconds"))
    rows = (("psnr", "PSNR, dB (higher is better)"), ("l1", "L1 (lower is better)"))
    colors = {name: f"C{i}" for i, name in enumerate(dict.fromkeys(name for name, _ in curves))}
    drawn = False
    for line, (key, title) in zip(figure.subplots(2, 2, sharex="col"), rows, strict=True):
        for axes, (time, label) in zip(line, columns, strict=True):
            for name, curve in curves:
                points = [p for p in curve if _finite(p, key) and _finite(p, time) and p[time] > 0]
                if not points:
                    continue
                drawn = True
                xs, ys = [p[time] for p in points], [p[key] for p in points]
                has_label = name in axes.get_legend_handles_labels()[1]
                axes.plot(xs, ys, color=colors[name], marker="o", markersize=3, linewidth=1.2,
                          label=None if has_label else name)  # fmt: skip
            if key == "psnr" and time == "cpu_seconds":
                if front:
                    ends = sorted(front)
                    axes.plot([x for x, _ in ends], [y for _, y in ends], "k--", linewidth=1.0, marker="*",
                              markersize=9, label="Pareto front, one size")  # fmt: skip
                if axes.lines:
                    axes.legend(fontsize=8, frameon=False, loc="lower right")
            axes.set_title(title, fontsize=9, color=_INK, loc="left")
            axes.set_xlabel(label, fontsize=8, color=_INK)
            axes.set_xscale("log")
            axes.grid(alpha=0.25, linewidth=0.6)
            axes.tick_params(labelsize=8, colors=_INK)
            axes.spines[["top", "right"]].set_visible(False)
    if not drawn:
        return b""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110, metadata={"Software": None})
    return buffer.getvalue()


def _finite(point: dict[str, Any], key: str) -> bool:
    value = point.get(key)
    # Matplotlib cannot place ticks at larger numbers.
    return isinstance(value, int | float) and math.isfinite(value) and abs(value) < 1e12
