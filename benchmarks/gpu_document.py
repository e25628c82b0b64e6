"""The generated part of docs/gpu.md, from the JSON files of ``python -m benchmarks.gpu``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

_STAGES = (
    "projection", "colours", "depth sort", "pairs", "tile sort", "blending", "blending backward", "segment sum",
    "projection backward", "colours backward",
)  # fmt: skip


def _read(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text()) if path.exists() else {}


def _ms(row: dict[str, Any] | None, key: str) -> str:
    return "-" if row is None or key not in row else f"{row[key]:.2f}"


def _mib(row: dict[str, Any] | None) -> str:
    return "-" if row is None else f"{row['memory_mib']:.0f}"


def _speed_table(scenes: dict[int, dict[str, Any]]) -> list[str]:
    lines = [
        "| Gaussians | case | forward, ours | gsplat | forward + backward, ours | gsplat | gsplat / ours | "
        "wall, ours | MiB, ours | MiB, gsplat |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for n, part in sorted(scenes.items()):
        for case, ours in part["ours"].items():
            theirs = part.get("gsplat", {}).get(case)
            ratio = "-" if theirs is None else f"{theirs['all'] / ours['all']:.2f}"
            lines.append(
                f"| {n:,} | {case} | {_ms(ours, 'forward')} | {_ms(theirs, 'forward')} | {_ms(ours, 'all')} | "
                f"{_ms(theirs, 'all')} | {ratio} | {_ms(ours, 'wall')} | {_mib(ours)} | {_mib(theirs)} |"
            )
    return lines


def _stage_table(scenes: dict[int, dict[str, Any]]) -> list[str]:
    columns = [(n, case) for n in sorted(scenes) for case in ("RGB, SH 3", "RGB+16")]
    lines = [
        "| stage | " + " | ".join(f"{n:,}: {case}" for n, case in columns) + " |",
        "| --- |" + " --- |" * len(columns),
    ]
    for stage in _STAGES:
        cells = " | ".join(_ms(scenes[n]["ours"][case], stage) for n, case in columns)
        lines.append(f"| {stage} | {cells} |")
    return lines


def _step_tables(results: Path) -> list[str]:
    lines = []
    for path in sorted(results.glob("step_*.json")):
        part, theirs = _read(path), _read(path.with_name(f"gsplat_{path.name}"))
        names = list(dict.fromkeys(name for row in part["cases"].values() for name in row))
        beside = ["gsplat", "gsplat / ours"] if theirs else []
        lines += [
            f"Whole steps with {int(path.stem.removeprefix('step_')):,} Gaussians on {part['card']}: milliseconds "
            "of wall time, medians, and megabytes of all buffers."
            + (f" gsplat's on {theirs['card']}, with {theirs['ssim']} SSIM." if theirs else ""),
            "",
            f"| step | {' | '.join([*names[:1], *beside, *names[1:]])} |",
            "| --- |" + " --- |" * (len(names) + len(beside)),
        ]
        for case, row in part["cases"].items():
            cells = [f"{row[name]:,.1f}" if name in row else "-" for name in names]
            other = theirs.get("cases", {}).get(case)
            of_gsplat = [f"{other['step']:.1f}", f"{other['step'] / row['step']:.2f}"] if other else ["-", "-"]
            lines.append(f"| {case} | {' | '.join([*cells[:1], *of_gsplat[: len(beside)], *cells[1:]])} |")
        lines.append("")
    return lines


def document(results: Path) -> str:
    """Return the tables of all results in a folder."""
    scenes = {int(path.stem.removeprefix("scene_")): _read(path) for path in results.glob("scene_*.json")}
    start, ceilings = _read(results / "start.json"), _read(results / "ceilings.json")
    some = next(iter(scenes.values()), start)
    machine = ", ".join(f"{name} {value}" for name, value in some["machine"].items())
    versions = "".join(f", {name} {value}" for name, value in some.get("versions", {}).items())
    lines = [f"Made by the commands of `make bench-gpu` on: {machine}{versions}.", ""]
    if scenes:
        pairs = ", ".join(f"{part['ours']['RGB']['n_pairs']:,}" for _, part in sorted(scenes.items()))
        lines += [
            f"1920x1080; {pairs} pairs of a tile and a Gaussian. Milliseconds, medians of 30 by timestamps "
            "of the card (ours) and CUDA events (gsplat). Wall: time of one of 200 steps queued one after the other, "
            "with encoding. MiB: all buffers with the inputs (ours), peak beyond the inputs (gsplat).",
            "",
            *_speed_table(scenes),
            "",
            "Where the time goes, milliseconds:",
            "",
            *_stage_table(scenes),
            "",
        ]
    lines += _step_tables(results)
    if ceilings:
        sort = "".join(
            f" torch.sort of {int(key.split('_')[2]):,} keys with their indices: {value:.2f} ms."
            for key, value in ceilings.items()
            if key.startswith("torch_sort")
        )
        lines += [
            f"Ceilings of simple WGSL kernels: copy {ceilings['copy_gb_s']:.0f} GB/s, counting bytes read and written; "
            f"FMA {ceilings['fma_tflop_s']:.1f} TFLOP/s.{sort}",
            "",
        ]
    if start:
        lines += [
            "| start of a process, seconds | driver's cache empty | second process | goal |",
            "| --- | --- | --- | --- |",
            f"| opening the card | {start['first']['open']:.2f} | {start['second']['open']:.2f} | - |",
            f"| compiling all kernels, a small picture and its gradients | {start['first']['compile']:.2f} | "
            f"{start['second']['compile']:.2f} | <= 10, <= 1.5 |",
        ]
    return "\n".join(lines).rstrip()
