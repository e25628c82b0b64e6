"""Make the measured tables of docs anew from the present code: ``make tables``, about two hours on two cores.

Each table has its own command, which docs tell above it. This script runs them in order: first the trained scenes that
they share, then the tables. Trainings and cameras of a stopped run are kept. Tables with a target of their own (`make
test-rooms`, `fuzz`, `kills`, `hostile`, `stability`, `bench-raster`) are not among them. Standard library only.

example: python scripts/make_tables.py --only words detail
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from places import ROOT, python_of

OUT = Path("out")
SCENES = ("museum_room", "store_room")
CHOOSING = ROOT / "demo" / "random_rooms" / "choosing"
METHODS = "paper,released,better"


def run(*command: str | Path) -> None:
    """Run a command with the engine's Python in the root of the repository; exit when it fails."""
    parts = [str(part) for part in command]
    print(f"\n$ python {' '.join(parts)}", flush=True)
    code = subprocess.run([python_of("engine"), *parts], cwd=ROOT, check=False).returncode
    if code:
        sys.exit(code)


def scenes() -> None:
    """Train the museum room, with its objects, and the store room."""
    run("scripts/demo.py")
    run("-m", "engine", "reconstruct", "demo/store_room/photos", "--out", OUT / "store_room" / "project")


def masks() -> None:
    """Objects prompted by true masks: docs/segmentation.md."""
    for scene, counts in zip(SCENES, ("1,2,4,8,16", "1,4,16"), strict=True):
        run(*_evaluate(scene, METHODS, "mask"), "--ablations", "--view-counts", counts, "--doc", "docs/segmentation.md")


def words() -> None:
    """Objects prompted by words, and found without a prompt: docs/text_prompts.md."""
    for scene in SCENES:
        run(*_evaluate(scene, METHODS, "text"), "--doc", "docs/text_prompts.md")
        run(*_evaluate(scene, "better", "all"), "--doc", "docs/text_prompts.md")


def detail() -> None:
    """Objects before and after detail: docs/detail.md."""
    document = "docs/detail.md"
    run("-m", "benchmarks.detail", OUT / "museum_room" / "project", "--out", document)
    projects = []
    for archive in sorted(CHOOSING.glob("room_*.tar.xz")):
        room = archive.name.removesuffix(".tar.xz")
        folder = OUT / "kept" / room
        projects.append(folder / "project")
        done = ROOT / folder / "all_prompted"
        if done.exists():
            continue
        shutil.rmtree(ROOT / folder, ignore_errors=True)
        run("-m", "benchmarks.rooms", "unpack", room, "--out", folder)
        names = json.loads((ROOT / folder / "truth" / "names.json").read_text(encoding="utf-8"))
        prompts = dict.fromkeys(entry["prompt"] for entry in names.values() if not entry.get("ignore"))
        run("-m", "engine", "segment", folder / "project", "--prompt", ";".join(prompts))
        done.touch()
    title = ("--title", "choosing rooms")
    run("-m", "benchmarks.detail", *projects, *title, "--out", document)


def clicks() -> None:
    """Clicks in the 3D view beside true masks: docs/viewport_clicks.md."""
    project, truth = OUT / "museum_room" / "project", Path("demo") / "museum_room" / "truth"
    run("-m", "benchmarks.viewport_clicks", project, "--truth", truth, "--doc", "docs/viewport_clicks.md")


def joint() -> None:
    """Cost of joint features: docs/segmentation.md."""
    command = ("-m", "benchmarks.joint_features", "demo/museum_room", "--out", OUT / "joint")
    run(*command, "--seeds", "0,1,2", "--doc", "docs/segmentation.md")


def _evaluate(scene: str, methods: str, kind: str) -> Sequence[str | Path]:
    project, truth = OUT / scene / "project", Path("demo") / scene / "truth"
    return ("-m", "engine", "evaluate", project, truth, "--presets", methods, "--prompt-kind", kind)


TABLES: dict[str, Callable[[], None]] = {
    "scenes": scenes, "masks": masks, "words": words, "detail": detail, "clicks": clicks, "joint": joint,
}  # fmt: skip


def main() -> None:
    """Run the chosen parts in order."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=tuple(TABLES), help="only these parts (default: all)")
    only = parser.parse_args().only
    for name, make in TABLES.items():
        if only is None or name in only:
            make()


if __name__ == "__main__":
    main()
