"""The table of all results: one row for each photo set and number of cores."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from .measuring import STEPS


def scale_table(results: Sequence[dict[str, Any]]) -> str:
    """Return the table and the growth of the time between sizes of the building on as many cores."""
    if not results:
        return "No results yet.\n"
    lines = [
        f"| photos | cores | {' | '.join(f'{step}, s' for step in STEPS)} | all, s | pairs | placed | "
        "position error, % | reprojection, px | memory, MB |",
        f"| --- | ---: | {'---: | ' * len(STEPS)}---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    lines += [_row(one) for one in sorted(results, key=_order)]
    lines += [
        "",
        *_growth(results),
        "",
        *(f"Computer: {name}." for name in sorted({one["machine"] for one in results})),
    ]
    return "\n".join(lines) + "\n"


def _order(one: dict[str, Any]) -> tuple[Any, ...]:
    return not one["name"].startswith("building"), one["n_photos"], one["name"], one["cores"]


def _row(one: dict[str, Any]) -> str:
    steps = [f"{one['wall'][step]:.1f} ({one['cpu'][step]:.0f})" if one["wall"][step] else "" for step in STEPS]
    total = f"{sum(one['wall'].values()):.0f} ({sum(one['cpu'].values()):.0f})"
    pairs = f"{one['n_pairs']}, {one['n_verified']}" if "n_pairs" in one else ""
    error = "unknown"
    if one["median_error"] is not None:
        error = f"{100 * one['median_error']:.3f}, {100 * one['largest_error']:.3f}"
    cells = [
        one["name"], str(one["cores"]), *steps, total, pairs, f"{one['n_placed']} of {one['n_photos']}",
        error, f"{one['error_px']:.2f}", f"{one['peak_bytes'] / 1e6:.0f}" if one["peak_bytes"] else "unknown",
    ]  # fmt: skip
    return f"| {' | '.join(cells)} |"


def _growth(results: Sequence[dict[str, Any]]) -> list[str]:
    """Return a sentence for each number of cores with at least two sizes of the building."""
    found = []
    for cores in sorted({one["cores"] for one in results}):
        sizes = [
            (one["n_photos"], sum(one["wall"].values()), sum(one["cpu"].values()))
            for one in results
            if one["cores"] == cores and one["name"].startswith("building")
        ]
        if len(sizes) < 2:
            continue
        (few, *least), (many, *most) = min(sizes), max(sizes)
        wall, cpu = (math.log(b / a) / math.log(many / few) for a, b in zip(least, most, strict=True))
        grows = f"grows as n^{wall:.2f} in wall time and n^{cpu:.2f} in CPU time"
        found.append(f"On {cores} cores, from {few} to {many} photos, it {grows}.")
    return found
