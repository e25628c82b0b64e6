"""A picture of test error against seconds: a part for each photo set, a line for each preset."""

from __future__ import annotations

import io
from typing import Any

from .reference import GSPLAT
from .table import Results

_COLUMNS = 3


def presets_plot(results: Results) -> bytes:
    """Return PSNR against CPU seconds as a PNG picture, beside what gsplat reaches; of several seeds, the first."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    sets = list(dict.fromkeys(name for name, _ in results))
    colors = {preset: f"C{i}" for i, preset in enumerate(dict.fromkeys(preset for _, preset in results))}
    rows = -(-len(sets) // _COLUMNS)
    figure = Figure(figsize=(4.0 * _COLUMNS, 2.9 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    parts = figure.subplots(rows, _COLUMNS, squeeze=False).flat
    for name, axes in zip(sets, parts, strict=False):
        for (one, preset), found in results.items():
            if one != name:
                continue
            points = [(point["cpu_seconds"], point["psnr"]) for point in found[0].curve]
            axes.plot(*zip(*points, strict=True), color=colors[preset], linewidth=1.2, label=preset)
            axes.plot(found[0].cpu_seconds, found[0].psnr, "o", color=colors[preset], markersize=5)
        if name in GSPLAT:
            axes.axhline(GSPLAT[name], color="0.4", linestyle="--", linewidth=0.9, label="gsplat, 3,000 steps")
        label_axes(axes, name, "CPU seconds of training")
        axes.legend(fontsize=7, frameon=False, loc="lower right")
    for axes in parts:
        axes.set_axis_off()
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=80, metadata={"Software": None})
    return buffer.getvalue()


def label_axes(axes: Any, name: str, seconds: str) -> None:
    """Give the part of a photo set its title, and a logarithmic axis of seconds with its label."""
    axes.set_title(f"{name}, test PSNR in dB", fontsize=9, loc="left")
    axes.set_xlabel(seconds, fontsize=8)
    axes.set_xscale("log")
    axes.grid(alpha=0.25, linewidth=0.6)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)
