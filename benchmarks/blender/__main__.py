"""Speed and likeness of splats in Blender, into docs/blender_speed.md: ``make bench-blender``; about 15 minutes.

Import in each Blender at hand; redraws and sliders in a real window with software OpenGL; pictures of Cycles and of
the viewports beside those of the engine. Needs what ``make window-test`` needs, and projects of a room and a statue.

example: python -m benchmarks.blender --museum out/museum_room/project --statue out/sakharov_statue32/project
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine.core.system import describe_machine
from engine.formats import write_ply
from engine.scene import Gaussians, read_camera_set

from ..documents import print_table
from ..pictures import psnr, read_picture
from ..places import blender_environments
from . import objects
from .likeness import engine_picture
from .processes import run_inside
from .window import BlenderWindow

_LARGE, _SLID = 1_000_000, 300_000
"""Gaussians of the imported file, and of the object whose threshold is changed."""
_SIDE = 480
"""Longest side of the compared pictures in pixels: Cycles takes about 0.2 ms of CPU a pixel."""
_SHARES = (1.0, 0.5, 0.25, 0.1)
_GIGABYTE = 1e9


@dataclass(frozen=True)
class Row:
    """A line of the table: what was measured, the result, the goal if there is one, and whether it is met."""

    what: str
    measured: str
    goal: str = ""
    is_met: bool = True

    def __str__(self) -> str:
        met = ("yes" if self.is_met else "**no**") if self.goal else ""
        return f"| {self.what} | {self.measured} | {self.goal} | {met} |"


def main() -> int:
    """Measure all, and write the document."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--museum", type=Path, required=True, help="project of the museum room")
    parser.add_argument("--statue", type=Path, required=True, help="project of sakharov_statue32")
    parser.add_argument(
        "--work", type=Path, default=Path("/tmp/gaussian_heritage_bench"), help="(default: %(default)s)"
    )
    parser.add_argument(
        "--root",
        type=Path,
        default=Path("/tmp/gaussian_heritage_window/root"),
        help="Debian root of the window (default: %(default)s)",
    )
    parser.add_argument("--doc", type=Path, help="put the tables between the marks of this document")
    options = parser.parse_args()
    if os.geteuid() != 0 or shutil.which("debootstrap") is None:
        print("The window needs root and debootstrap (Debian: apt-get install debootstrap).", file=sys.stderr)
        return 1
    for project in (options.museum, options.statue):
        if not (project / "gaussians" / "scene.ply").is_file():
            print(f"{project} has no trained scene. Make it first, see `make bench-blender`.", file=sys.stderr)
            return 1
    options.work.mkdir(parents=True, exist_ok=True)
    projects = {"museum room": options.museum.absolute(), "statue": options.statue.absolute()}
    large = options.work / "large.ply"
    write_ply(large, random_gaussians(_LARGE))
    blenders = blender_environments()
    rows = [import_row(name, large) for name in blenders]
    goals = {"museum room": 28.0, "statue": 26.0}
    expected = {
        name: [engine_picture(one, photo, _SIDE, options.work) for photo in photos(one)]
        for name, one in projects.items()
    }
    for name, project in projects.items():
        rows.append(cycles_row(name, project, expected[name], goals[name], blenders[-1], options.work))
    sees = [options.work, *(project for project in projects.values())]
    with BlenderWindow(options.work / "window", options.root, sees) as window:
        version = window.version
        likeness = [likeness_row(window, name, project, expected[name]) for name, project in projects.items()]
        rows += window_rows(window, projects["museum room"], large)
    print_table(speed_table(rows, version), options.doc, "speed")
    print_table(likeness_table(likeness), options.doc, "likeness")
    print_table(objects.table(options.museum, options.work), options.doc, "objects")
    return 0


def random_gaussians(count: int) -> Gaussians:
    """Return random Gaussians with spherical harmonics of degree 3."""
    rng = np.random.default_rng(0)

    def normal(*shape: int) -> NDArray[np.float32]:
        return rng.standard_normal(shape).astype(np.float32)

    return Gaussians(
        normal(count, 3), normal(count, 3) / 2 - 5, normal(count, 4), normal(count), normal(count, 16, 3) / 5
    )


def import_row(blender: str, file: Path) -> Row:
    """Measure the import of a large file."""
    cost = run_inside(blender, "import", file)
    peak = cost["peak"] / _GIGABYTE
    measured = f"{cost['cpu']:.1f} CPU s, {cost['wall']:.1f} s, {peak:.2f} GB"
    what = f"import of {_LARGE:,} Gaussians with SH 3, bpy {cost['blender']}; memory of the whole process"
    return Row(what, measured, "5 s, 1.5 GB", cost["cpu"] <= 5 and peak <= 1.5)


def photos(project: Path) -> list[str]:
    """Return the photos whose views are compared: the first, and the middle one."""
    cameras = read_camera_set(project / "cameras").cameras
    names = sorted(camera.photo for camera in cameras)
    return [names[0], names[len(names) // 2]]


def cycles_row(name: str, project: Path, expected: list[Any], goal: float, blender: str, work: Path) -> Row:
    """Compare pictures of Cycles with those of the engine."""
    values, cpu = [], 0.0
    for photo, reference in zip(photos(project), expected, strict=True):
        out = work / f"cycles_{name.replace(' ', '_')}.png"
        cost = run_inside(blender, "cycles", project, photo, str(_SIDE), out)
        cpu += cost["cpu"]
        values.append(psnr(read_picture(out), reference))
    height, width = expected[0].shape[:2]
    what = f"Cycles beside the engine, {name}, {len(values)} views of {width} x {height}, bpy {cost['blender']}"
    measured = f"{' and '.join(f'{value:.1f}' for value in values)} dB; {cpu / len(values):.0f} CPU s each"
    return Row(what, measured, f"{goal:.0f} dB", min(values) >= goal)


def likeness_row(window: BlenderWindow, name: str, project: Path, expected: list[Any]) -> str:
    """Compare what the viewports draw with the pictures of the engine, by shares of the Gaussians."""
    window.open(project)
    values = []
    for share in _SHARES:
        pictures = [window.picture(photo, _SIDE, share) for photo in photos(project)]
        values.append(np.mean([psnr(one, reference) for one, reference in zip(pictures, expected, strict=True)]))
    return f"| {name} | {' | '.join(f'{value:.1f}' for value in values)} |"


def window_rows(window: BlenderWindow, museum: Path, large: Path) -> list[Row]:
    """Measure redraws and sliders in the window."""
    window.open(museum)
    empty = window.call("nothing_shown")
    clicked, asked = window.call("click")
    rows = [
        Row("first click on the museum room in a session, Object Mode", _cost(clicked), "0.1 s", clicked[0] <= 0.1),
        Row("Blender's own selection after it, asked for the first time", _cost(asked)),
        Row("redraw of the window without splats, Solid", _cost(empty)),
    ]
    for what, goal, display in (
        ("splats, lighter while turning, Solid", 2.0, {"kind": "SPLATS"}),
        ("splats, at full size, Solid", 0.0, {"kind": "SPLATS", "lighter": False}),
        ("points, Solid", 0.0, {"kind": "POINTS"}),
        ("splats, lighter while turning, Material Preview", 0.0, {"kind": "SPLATS", "shading": "MATERIAL"}),
    ):
        cost = window.call("turn", **display)
        rows.append(
            Row(
                f"redraw of the museum room while turning: {what}",
                _cost(cost),
                f"{goal:.0f} s" if goal else "",
                cost[0] <= goal,
            )
        )
    window.call("show", "SPLATS")
    evaluated, redrawn, rest = window.call("slide", _SLID)
    rows.append(
        Row(
            f"threshold of {_SLID:,} Gaussians: until Blender has evaluated it",
            _cost(evaluated),
            "0.2 s",
            evaluated[0] <= 0.2,
        )
    )
    rows.append(Row("the same, until the window is redrawn", _cost(redrawn)))
    rows.append(Row("a redraw of the same window without a change", _cost(rest)))
    first = window.call("import_large", str(large))
    rows.append(Row(f"first redraw of {_LARGE:,} Gaussians with SH 3, of which {first[2]:.0%} are shown", _cost(first)))
    rows.append(Row("redraw of these while turning: splats, lighter", _cost(window.call("turn", kind="SPLATS"))))
    return rows


def _cost(cost: list[float]) -> str:
    return f"{cost[0]:.2f} CPU s, {cost[1]:.2f} s"


def speed_table(rows: list[Row], version: str) -> str:
    """Return the table of costs and of pictures by Cycles, with the computer and the goals that were missed."""
    missed = [row.what for row in rows if row.goal and not row.is_met]
    lines = [
        f"Machine: {describe_machine().name}, shared with other work, without a graphics card.",
        f"Window: Blender {version}, 1600 x 1000 pixels.",
        "", "| what | measured | goal | met |", "| --- | --- | --- | --- |", *map(str, rows), "",
        f"Missed: {'; '.join(missed)}." if missed else "No goal was missed.",
    ]  # fmt: skip
    return "\n".join(lines)


def likeness_table(rows: list[str]) -> str:
    """Return the table of PSNR by shares of the Gaussians."""
    shares = " | ".join(f"{share:.0%}" for share in _SHARES)
    return "\n".join((f"| scene | {shares} |", f"| --- |{' ---: |' * len(_SHARES)}", *rows))


if __name__ == "__main__":
    sys.exit(main())
