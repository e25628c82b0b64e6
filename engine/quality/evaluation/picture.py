"""Plot of an evaluation: IoU against CPU seconds."""

from __future__ import annotations

import io
from collections.abc import Sequence

from .results import Evaluation, Row, mean_of
from .settings import methods_of

_INK = "#2b2a27"


def curve_picture(evaluation: Evaluation) -> bytes:
    """Return mean IoU and boundary IoU against mean CPU seconds as a PNG picture.

    A line connects the numbers of views of a preset, which are written beside its points. Other methods are points.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.6, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    methods = methods_of(evaluation.settings)
    for axes, title in zip(figure.subplots(1, 2, sharex=True), ("IoU", "boundary IoU"), strict=True):
        for preset in evaluation.settings.presets:
            points = sorted(
                (method.n_views, *_point(evaluation.rows, method.name, title))
                for method in methods
                if method.preset == preset
            )
            axes.plot([x for _, x, _ in points], [y for *_, y in points], marker="o", markersize=4, label=preset)
            for n_views, x, y in points:
                if n_views:
                    axes.annotate(f"{n_views}", (x, y), (3, 4), textcoords="offset points", fontsize=7, color=_INK)
        for method in methods:
            if not method.preset:
                x, y = _point(evaluation.rows, method.name, title)
                axes.plot([x], [y], linestyle="", marker="x", markersize=6, label=method.name)
        axes.set_title(f"{title}, % (beside the points: number of photos)", fontsize=9, color=_INK, loc="left")
        axes.set_xlabel("CPU seconds from the prompt to the object", fontsize=8, color=_INK)
        axes.grid(alpha=0.25, linewidth=0.6)
        axes.tick_params(labelsize=8, colors=_INK)
        axes.spines[["top", "right"]].set_visible(False)
    figure.axes[0].legend(fontsize=7, frameon=False)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110, metadata={"Software": None})
    return buffer.getvalue()


def _point(rows: Sequence[Row], method: str, measure: str) -> tuple[float, float]:
    own = [row for row in rows if row.method == method]
    values = [row.iou if measure == "IoU" else row.boundary_iou for row in own]
    return mean_of([row.cpu_seconds for row in own]), 100 * mean_of(values)
