"""Output of a comparison: a Markdown table with its command, JSON with the curves, and a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ... import __version__
from ...core.files import finite_or_null, write_file, write_json
from ...core.system import describe_machine, describe_system
from ...delivery.report import compare_curves
from ..evaluation import write_section
from ..evaluation.settings import IN_SAMPLE_PHOTO_SETS, IN_SAMPLE_SCENES, MARKS
from .comparison import Row, pareto_front, savings

_EXPLANATION = """## What the columns mean

Errors of all rows are measured at the picture size of the largest preset. The curves were measured during training,
each at the picture size of its preset.

- fitted: PSNR with the brightness of each picture fitted to its photo, whose exposure is unknown.
- well seen: PSNR in the pixels that show what at least three training photos see, with their share.
- dark: pixels brighter than 40 of 255 that are rendered less than half as bright, in percent of them.

FLIP is the mean visible difference (Andersson et al. 2020), lower is better.
LPIPS is not measured, because its weights are not available here. Seconds are those of training without the
measurements; cameras and masks are shared. A row is on the Pareto front when no other row is at least as good in
less CPU time. CPU seconds are compared, because wall seconds also depend on other programs. The peak memory is that
of the whole process during training, in the order of the rows."""


def markdown(rows: Sequence[Row]) -> str:
    """Return the table, and the savings of leaving out where they were measured."""
    lines = [
        "| preset | steps | Gaussians | PSNR dB | fitted | well seen | SSIM | L1 | FLIP | dark % | wall s | CPU s "
        "| peak memory | on the Pareto front |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | --- |",
    ]
    for row, on_front in zip(rows, pareto_front(rows), strict=True):
        memory = f"{row.peak_memory / 1e9:.2f} GB" if row.peak_memory else "not known"
        cells = [
            f"`{row.name}`{_seed_suffix(row, rows)}", f"{row.steps:,}", f"{row.n_gaussians:,}",
            _number(row.psnr, ".2f"), _number(row.fitted_psnr, ".2f"), _well_seen(row),
            _number(row.ssim, ".3f"), _number(row.l1, ".4f"), _number(row.flip, ".4f"),
            _number(None if row.dark_share is None else 100 * row.dark_share, ".2f"), f"{row.wall_seconds:.0f}",
            f"{row.cpu_seconds:.0f}", memory, "yes" if on_front else "no",
        ]  # fmt: skip
        lines.append(f"| {' | '.join(cells)} |")
    remarks = [f"- `{row.name}`{_seed_suffix(row, rows)}: {row.remark}" for row in rows if row.remark]
    return "\n".join([*lines, *([""] + remarks if remarks else []), *_savings_lines(rows)])


def _savings_lines(rows: Sequence[Row]) -> list[str]:
    lines = []
    for name, saved in savings(rows).items():
        text = (
            f"- `{name}`: leaving out saved {saved['training_cpu_seconds']:.0f} CPU s of training "
            f"({saved['training_share']:.0%})"
        )
        if "mask_cpu_seconds" in saved:
            text += f" and {saved['mask_cpu_seconds']:.0f} CPU s of masks; together {saved['share']:.0%}"
        error = saved.get("psnr_lost_error")
        unit = f" ± {error:.2f} dB on average over seeds" if error is not None else " dB"
        lines.append(f"{text}, and cost {saved['psnr_lost']:.2f}{unit} on test photos (measured)")
    return ["", *lines] if lines else []


def _well_seen(row: Row) -> str:
    if row.well_seen_psnr is None or row.well_seen_share is None:
        return "-"
    return f"{row.well_seen_psnr:.2f} ({row.well_seen_share:.0%})"


def _seed_suffix(row: Row, rows: Sequence[Row]) -> str:
    """Return the seed of `row` when rows differ in it, else nothing."""
    return f", seed {row.seed}" if len({other.seed for other in rows}) > 1 else ""


def _number(value: float | None, form: str) -> str:
    return format(value, form) if value is not None else "-"


def write_comparison(out: Path, rows: Sequence[Row], *, title: str, command: str, doc: Path | None = None) -> Path:
    """Write ``bench.md``, ``bench.json`` and ``bench.png`` into `out`, and the text and picture to `doc` as well.

    Parameters
    ----------
    title : str
        Title of the scene.
    command : str
        Command that made the table; it is printed above it.
    doc : Path, optional
        Another Markdown file with one section per scene, which is added or replaced. The picture is written beside
        it.

    Returns
    -------
    Path
        The Markdown file in `out`.
    """
    front = [(row.cpu_seconds, row.psnr) for row, on in zip(rows, pareto_front(rows), strict=True) if on and row.psnr]
    picture = compare_curves([(row.name, row.curve) for row in rows], front)
    write_json(out / "bench.json", finite_or_null(_as_json(rows, title=title, command=command)))
    in_sample = title in (*IN_SAMPLE_SCENES, *IN_SAMPLE_PHOTO_SETS)
    body = _body(rows, command=command, mark=MARKS["in sample" if in_sample else "test"])
    _write_picture(out / "bench.png", picture)
    write_file(
        out / "bench.md",
        f"# {title}: error against run time\n\n{body}\n\n{_picture_link('bench.png', picture)}{_EXPLANATION}\n",
    )
    if doc:
        image = doc.with_name(f"{doc.stem}_{title}.png".replace(" ", "_"))
        _write_picture(image, picture)
        text = f"{body}\n\n{_picture_link(image.name, picture)}"
        write_section(doc, introduction="# Error against run time", title=title, body=text, closing=_EXPLANATION)
    return out / "bench.md"


def _write_picture(path: Path, picture: bytes | None) -> None:
    if picture:
        write_file(path, picture)


def _picture_link(name: str, picture: bytes | None) -> str:
    return f"![Error against run time, all presets]({name})\n\n" if picture else ""


def _body(rows: Sequence[Row], *, command: str, mark: str) -> str:
    measured = next((row.measured_on for row in rows if row.measured_on), "test photos")
    machine = describe_machine()
    return (
        f"```\n{command}\n```\n\n{mark}\n\n{markdown(rows)}\n\n"
        f"Errors on {measured}. Gaussian Heritage {__version__}, {machine.cores} cores, "
        f"{describe_system()}{_cards(rows)}."
    )


def _cards(rows: Sequence[Row]) -> str:
    """Return what was trained on graphics cards, whose work CPU seconds do not tell; nothing without a card."""
    names: dict[str, list[str]] = {}
    for row in rows:
        if row.device != "cpu":
            names.setdefault(row.device, []).append(f"`{row.name}`")
    return "".join(f"; trained on {device}: {', '.join(dict.fromkeys(found))}" for device, found in names.items())


def _as_json(rows: Sequence[Row], *, title: str, command: str) -> dict[str, Any]:
    front = pareto_front(rows)
    return {
        "title": title,
        "command": command,
        "rows": [{**asdict(row), "on_pareto_front": on} for row, on in zip(rows, front, strict=True)],
        "savings": savings(rows),
    }
