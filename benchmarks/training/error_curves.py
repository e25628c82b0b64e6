"""Test error against seconds of presets on a card and on processors, and of gsplat: a table and a picture."""

from __future__ import annotations

import io
import statistics
from collections.abc import Iterator, Sequence
from typing import Any

from engine.training.settings import PRESETS

from .gsplat_training import GSPLAT
from .presets_plot import label_axes

ERROR_AND_SECONDS = "error and seconds"
"""Name of the table in a document."""

SETS_AND_RUNS = "sets and runs"
"""Name of the table of all sets in a document."""

_CARD = "card"


def error_table(results: Sequence[dict[str, Any]]) -> str:
    """Return a row for each result, by set, device and seconds."""
    lines = [
        "| set | device | training | steps | Gaussians | test PSNR dB | fitted | wall s | CPU s |",
        "| --- | --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for name, device, run, result in _sorted(results):
        one = result["figures"]
        steps = one.get("steps", run.split(":")[0])
        cpu = f"{one['cpu_seconds']:.0f}" if "cpu_seconds" in one else ""
        lines.append(
            f"| {name} | {device} | {_label(run)} | {int(steps):,} | {one['n_gaussians']:,} | {one['psnr']:.2f} | "
            f"{one['fitted_psnr']:.2f} | {one['wall_seconds']:.1f} | {cpu} |"
        )
    return "\n".join(lines)


def sets_table(results: Sequence[dict[str, Any]]) -> str:
    """Return PSNR (fitted) in the mean of the seeds: a row for each set, a column for each device and run."""
    cells: dict[str, dict[tuple[str, str], list[dict[str, Any]]]] = {}
    seconds: dict[tuple[str, str], float] = {}
    for name, device, run, result in _sorted(results):
        figures, column = result["figures"], (device, run)
        cells.setdefault(name, {}).setdefault(column, []).append(figures)
        seconds[column] = max(seconds.get(column, 0.0), figures["wall_seconds"])
    columns = sorted(seconds, key=lambda column: (column[0] == GSPLAT, column[0], seconds[column]))
    titles = [f"{device}: {_label(run) or run}" for device, run in columns]
    lines = [f"| set | {' | '.join(titles)} |", "| --- |" + " ---: |" * len(columns)]
    for name, row in cells.items():
        lines.append(f"| {name} | {' | '.join(_mean_psnr(row.get(column, ())) for column in columns)} |")
    return "\n".join(lines)


def _mean_psnr(found: Sequence[dict[str, Any]]) -> str:
    if not found:
        return ""
    psnr, fitted = (statistics.mean(one[name] for one in found) for name in ("psnr", "fitted_psnr"))
    return f"{psnr:.2f} ({fitted:.2f})" + (f", {len(found)}" if len(found) > 1 else "")


def error_plot(results: Sequence[dict[str, Any]]) -> bytes:
    """Return PSNR against seconds as a PNG picture: a part for each set, a colour for each device.

    Of our trainings, the measurements during training are drawn; of gsplat, whose rates follow from the number of
    steps, the ends of its trainings.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = list(_sorted(results))
    sets = list(dict.fromkeys(name for name, *_ in rows))
    colors = {device: f"C{i}" for i, device in enumerate(dict.fromkeys(device for _, device, *_ in rows))}
    figure = Figure(figsize=(5.2 * len(sets), 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    for name, axes in zip(sets, figure.subplots(1, len(sets), squeeze=False)[0], strict=True):
        ends: dict[str, list[tuple[float, float]]] = {}
        for _, device, _, result in (row for row in rows if row[0] == name):
            one = result["figures"]
            ends.setdefault(device, []).append((one["wall_seconds"], one["psnr"]))
            measured = [(point["wall_seconds"], point["psnr"]) for point in one["curve"]]
            if measured:
                axes.plot(*zip(*measured, strict=True), color=colors[device], linewidth=0.9)
        for device, points in ends.items():
            style = "--o" if device == GSPLAT else "o"
            axes.plot(
                *zip(*points, strict=True), style, color=colors[device], linewidth=0.9, markersize=5, label=device
            )
        label_axes(axes, name, "wall seconds of training")
        axes.legend(fontsize=8, frameon=False, loc="lower right")
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=100, metadata={"Software": None})
    return buffer.getvalue()


def _sorted(results: Sequence[dict[str, Any]]) -> Iterator[tuple[str, str, str, dict[str, Any]]]:
    """Yield set, device, run and result, by set, device and seconds."""

    def place(row: tuple[str, str, str, dict[str, Any]]) -> tuple[str, bool, str, float]:
        return row[0], row[1] == GSPLAT, row[1], row[3]["figures"]["wall_seconds"]

    yield from sorted(((result["set"], *_device(result["run"]), result) for result in results), key=place)


def _device(run: str) -> tuple[str, str]:
    """Return the device of a run and the rest of its name."""
    first, _, rest = run.partition(":")
    if first == GSPLAT:
        return GSPLAT, rest
    return (f"processor, {first}", rest) if first.endswith(" cores") else (_CARD, run)


def _label(run: str) -> str:
    first, *others = run.split(":")
    return ", ".join([f"`{first}`", *others]) if first in PRESETS else ""
