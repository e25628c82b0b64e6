"""The whole path from photos to the report, taken apart: ``make bench-path``, or ``python -m benchmarks.path run``.

``run`` reconstructs a photo set with objects by the command line, as users do, and stores what the engine tells of its
time (the event `Finished`) in ``OUT/path.json``. Kernels are compiled and the speed of the machine is measured before,
as both are done once per computer. ``document`` writes the tables of all given results, of several machines, into the
part `path` of a document. CPU seconds are those of all processes together.

example: python -m benchmarks.path run --device cpu --out out/path
         python -m benchmarks.path document out/path/path.json out/path_card/path.json --doc docs/run_time.md
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from engine.core.engine_process import engine_command, engine_environment, events_in
from engine.core.events import Finished, Preview
from engine.core.files import write_json
from engine.core.system import cpu_seconds, describe_machine
from engine.pipeline.stages import STAGES
from engine.project.folder import ProjectFolder

from .documents import print_table
from .places import ROOT
from .processes import cpu_of_tree

PHOTOS = ROOT / "demo" / "museum_room" / "photos"
PROMPTS = "vase;teapot;obelisk;shield;mask;hourglass;goblet;drum"
"""The eight words of `make demo`."""

_NAMED = 0.01
"""Share of the whole from which on a part has a row of its own."""
_BEFORE_STAGES = "planning"
_KINDS = {
    "start and end of the process": ("start and end of the process",),
    "imports": ("imports",),
    "compilation": ("compilation",),
    "self-test of the card": ("self-test of the card",),
    "loading models": ("loading models",),
    "measurements and previews": ("measurements", "previews", "pictures of test photos"),
    "reading photos": ("reading photos", "copying the photos"),
    "writing": ("writing", "storing"),
    "waiting": ("waiting for the encoder",),
}
"""Parts of all stages that are not the work itself, by what they are called in the table."""


def measure(photos: Path, out: Path, *, prompts: str, preset: str, device: str) -> dict[str, Any]:
    """Reconstruct the photos and return what is stored of the run, JSON values."""
    project, calibration = out / "project", out / "calibration.json"
    shutil.rmtree(project, ignore_errors=True)
    calibration.unlink(missing_ok=True)
    environment = {**engine_environment(), "GAUSSIAN_HERITAGE_CALIBRATION": str(calibration)}
    asked = ["--preset", preset, "--device", device]
    subprocess.run(
        engine_command("plan", photos, *asked), env=environment, cwd=ROOT, check=True, stdout=subprocess.DEVNULL
    )
    command = engine_command("reconstruct", photos, "--out", project, "--prompts", prompts, *asked, "--events")
    load, begin, cpu = os.getloadavg()[0], time.perf_counter(), cpu_seconds()
    picture: dict[str, Any] | None = None
    parts: Mapping[str, Sequence[float]] = {}
    with subprocess.Popen(command, env=environment, cwd=ROOT, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        for event in events_in(process.stdout):
            if isinstance(event, Preview) and picture is None:
                wall = time.perf_counter() - begin
                picture = {"stage": event.stage, "wall": wall, "cpu": cpu_of_tree(process.pid)}
            if isinstance(event, Finished):
                parts = event.parts
    if process.returncode:
        raise SystemExit(f"The run failed; see {project / 'log.jsonl'}.")
    whole = (time.perf_counter() - begin, cpu_seconds() - cpu)
    opened = ProjectFolder.open_existing(project)
    training, objects = (opened.stage_record(stage) or {} for stage in ("training", "objects"))
    return {
        "machine": describe_machine().name,
        "device": training["figures"]["device"],
        "photos": str(photos.relative_to(ROOT) if photos.is_relative_to(ROOT) else photos),
        "n_photos": opened.stage_record("photos")["figures"]["n_photos"],  # type: ignore[index]
        "preset": preset,
        "n_objects": sum(map(len, objects.get("figures", {}).get("found", {}).values())),
        "whole": whole,
        "load": max(load, os.getloadavg()[0]),
        "first_picture": picture,
        "parts": parts,
        "forecast": {one["stage"]: one for one in opened.get("forecast")["stages"]},
        "stages": {stage: record for stage in STAGES if (record := _cost(opened.stage_record(stage)))},
        "results": _digests(opened),
    }


def _cost(record: Mapping[str, Any] | None) -> dict[str, float] | None:
    return None if record is None else {"wall": record["wall_seconds"], "cpu": record["cpu_seconds"]}


def _digests(project: ProjectFolder) -> dict[str, str]:
    """Return the beginning of the SHA-256 of the outputs of each stage, which tells whether two runs made the same."""
    return {
        name: record["sha256"][:12]
        for stage in ("cameras", "training")
        for name, record in project.recorded_outputs(stage).items()
    }


def table(run: Mapping[str, Any]) -> str:
    """Return the table of a run with what is said above and below it."""
    whole, parts = run["whole"], _with_rest(run)
    lines = [_said_of(run), "", "| stage | part | wall s | share | CPU s | share |", "| --- | --- |" + " ---: |" * 4]
    rest = [0.0, 0.0]
    for stage in (_BEFORE_STAGES, *STAGES, ""):
        own = {path: both for path, both in parts.items() if path.partition("/")[0] == stage or (not stage and path in
               ("", "imports", "start and end of the process"))}  # fmt: skip
        if not own:
            continue
        lines.append(_row(f"**{stage or 'the command itself'}**", "", _sum(own.values()), whole))
        inner: dict[str, list[float]] = {}
        for path, both in own.items():
            name = path.removeprefix(stage).strip("/").replace("/", ": ") or "what has no name"
            inner[name] = _sum([inner.get(name, [0.0, 0.0]), both])
        for name, both in sorted(inner.items(), key=lambda one: -one[1][1]):
            if name == "what has no name":
                rest = _sum([rest, both])
            if max(both[clock] / whole[clock] for clock in range(2)) >= _NAMED:
                lines.append(_row("", name, both, whole))
    lines += [_row("**whole**", "", whole, whole), "", _kinds(parts, whole), "", _forecasts(run)]
    shares = [100 * rest[clock] / whole[clock] for clock in range(2)]
    lines += ["", f"No name: {shares[0]:.1f} % of the wall and {shares[1]:.1f} % of the CPU seconds of the whole."]
    return "\n".join(lines)


def _said_of(run: Mapping[str, Any]) -> str:
    results = ", ".join(f"`{Path(name).name}` {digest}" for name, digest in run["results"].items())
    picture = run["first_picture"]
    seen = "no picture" if picture is None else (
        f"first picture of the scene after {picture['wall']:.0f} s and {picture['cpu']:.0f} CPU s, in the stage "
        f"{picture['stage']}"
    )  # fmt: skip
    device = "the processor" if run["device"] == "cpu" else run["device"]
    return (
        f"{run['photos']}, {run['n_photos']} photos, preset {run['preset']}, {run['n_objects']} objects, on {device}; "
        f"{run['machine']}; load of the machine {run['load']:.1f}. In sample. {seen[0].upper()}{seen[1:]}. "
        f"SHA-256 of the results: {results}."
    )


def _with_rest(run: Mapping[str, Any]) -> dict[str, list[float]]:
    """Return the parts of a run with what the process took outside of them."""
    parts = {path: list(both) for path, both in run["parts"].items()}
    booked = _sum(parts.values())
    parts["start and end of the process"] = [run["whole"][clock] - booked[clock] for clock in range(2)]
    return parts


def _sum(several: Sequence[Sequence[float]] | Any) -> list[float]:
    return [sum(both[clock] for both in several) for clock in range(2)]


def _row(stage: str, name: str, both: Sequence[float], whole: Sequence[float]) -> str:
    cells = " | ".join(f"{both[clock]:,.1f} | {100 * both[clock] / whole[clock]:.1f} %" for clock in range(2))
    return f"| {stage} | {name} | {cells} |"


def _kinds(parts: Mapping[str, Sequence[float]], whole: Sequence[float]) -> str:
    rows = ["| in all stages | wall s | share | CPU s | share |", "| --- |" + " ---: |" * 4]
    for kind, names in _KINDS.items():
        both = _sum([one for path, one in parts.items() if path.rpartition("/")[2] in names])
        rows.append(_row(kind, "", both, whole).replace("|  | ", "| "))
    return "\n".join(rows)


def _forecasts(run: Mapping[str, Any]) -> str:
    """Return the forecasts, made with no earlier run to correct them, beside what was measured."""
    rows = ["| forecast | CPU s | measured | ratio | wall s | measured | ratio |", "| --- |" + " ---: |" * 6]
    sums = [0.0] * 4
    for stage, cost in run["stages"].items():
        expected = run["forecast"][stage]
        four = [expected["cpu_seconds"], cost["cpu"], expected["seconds"], cost["wall"]]
        sums = [before + one for before, one in zip(sums, four, strict=True)]
        rows.append(_forecast_row(stage, four))
    return "\n".join([*rows, _forecast_row("**whole**", sums)])


def _forecast_row(name: str, four: Sequence[float]) -> str:
    cpu, used, wall, taken = four
    ratio = f"{taken / wall:.2f}" if wall else ""  # masks are made beside the cameras
    return f"| {name} | {cpu:,.1f} | {used:,.1f} | {used / cpu:.2f} | {wall:,.1f} | {taken:,.1f} | {ratio} |"


def main() -> None:
    """Run the benchmark, or write the document."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    run = commands.add_parser("run", help="reconstruct a photo set and store where its time went")
    run.add_argument("--photos", type=Path, default=PHOTOS, help="folder with photos (default: the museum room)")
    run.add_argument("--prompts", default=PROMPTS, help="objects to isolate (default: %(default)s)")
    run.add_argument("--preset", default="standard", help="preset of the settings (default: %(default)s)")
    run.add_argument("--device", default="auto", choices=("auto", "cpu", "gpu"), help="what trains and renders")
    run.add_argument("--out", type=Path, default=Path("out/path"), help="folder (default: %(default)s)")
    document = commands.add_parser("document", help="write the tables of runs into a document")
    document.add_argument("runs", type=Path, nargs="+", help="path.json of each run")
    document.add_argument("--doc", type=Path, help="document whose part `path` is replaced")
    options = parser.parse_args()
    if options.command == "run":
        options.out.mkdir(parents=True, exist_ok=True)
        found = measure(
            options.photos.resolve(), options.out.resolve(),
            prompts=options.prompts, preset=options.preset, device=options.device,
        )  # fmt: skip
        write_json(options.out / "path.json", found)
        sys.stdout.write(table(found) + "\n")
        return
    text = "\n\n".join(table(json.loads(file.read_text(encoding="utf-8"))) for file in options.runs)
    print_table(text, options.doc, "path")


if __name__ == "__main__":
    main()
