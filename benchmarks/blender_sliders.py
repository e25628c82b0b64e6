"""How long Blender's sliders take: ``python -m benchmarks.blender_sliders [--out FILE.md]``, in each Blender at hand.

An object of 300,000 Gaussians is shown, then its membership threshold and its level (part to whole) are moved: from the
property to the depsgraph's new instances. Nothing is rendered. The goal is 0.2 s.

example: python -m benchmarks.blender_sliders
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "scripts"))

from check_contracts import link_repository  # noqa: E402
from places import blender_environments, python_of  # noqa: E402

_COUNT, _LEVELS, _REPEATS = 300_000, 3, 10
_HEAD = f"""# Blender's sliders

Written by `python -m benchmarks.blender_sliders --out docs/blender_sliders.md`. One object of {_COUNT:,} Gaussians,
median of {_REPEATS} moves, until Blender has its new instances; goal 0.2 s.

| Blender | slider | CPU s | wall s | drawn before and after |
| --- | --- | ---: | ---: | --- |
"""


def main() -> int:
    """Measure in each Blender, print, and write where wanted."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="Markdown file for the table")
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.here:
        _say_and_leave()
    text = _HEAD
    for name in blender_environments():
        command = [str(python_of(name)), "-m", "benchmarks.blender_sliders", "--here"]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        if done.returncode:
            print(f"{name}: {done.stderr.strip().splitlines()[-1]}", file=sys.stderr)
            return 1
        for row in json.loads(done.stdout.splitlines()[-1]):
            text += f"| {row['blender']} | {row['slider']} | {row['cpu']:.3f} | {row['wall']:.3f} | {row['drawn']} |\n"
    print(text)
    if arguments.out:
        arguments.out.write_text(text, encoding="utf-8")
    return 0


def _say_and_leave() -> NoReturn:
    code = 1
    try:
        print(json.dumps(measure()), flush=True)
        code = 0
    except Exception as error:
        print(repr(error), file=sys.stderr, flush=True)
    # Blender's own clearing up waits forever where references to its data are left, as after an error.
    os._exit(code)


def measure() -> list[dict[str, Any]]:
    """Return a row for each slider of this very Blender."""
    import bpy

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        link_repository(folder)
        sys.path.insert(0, str(folder))
        import gaussian_heritage  # type: ignore[import-not-found]

        gaussian_heritage.register()
        bpy.ops.wm.read_homefile(use_empty=True)
        obj = _object(folder / "project")
        said = obj.heritage

        def threshold(number: int) -> None:
            said.threshold = 0.3 + 0.05 * (number % 8)

        def level(number: int) -> None:
            said.part_to_whole = number % _LEVELS / (_LEVELS - 1)

        version = ".".join(map(str, bpy.app.version))
        return [
            {"blender": version, "slider": words, **_cost(obj, move)}
            for words, move in (("threshold", threshold), ("part to whole", level))
        ]


def _object(project: Path) -> Any:
    """Return an isolated object of a project with levels on the disk."""
    import bpy
    from gaussian_heritage.engine.gaussians.gaussians import Gaussians
    from gaussian_heritage.gaussian_heritage_addon.splats import SplatScene

    rng = np.random.default_rng(0)

    def normal(*shape: int) -> Any:
        return rng.standard_normal(shape).astype(np.float32)

    gaussians = Gaussians(
        means=normal(_COUNT, 3),
        log_scales=normal(_COUNT, 3) - 4,
        quats=normal(_COUNT, 4),
        opacity_logits=normal(_COUNT) + 2,
        sh=normal(_COUNT, 4, 3),
    )
    levels = np.clip(rng.random(_COUNT) + np.array([[-0.4], [0.0], [0.4]]), 0, 1).astype(np.float32)
    file = project / "objects" / "vase" / "levels.npy"
    file.parent.mkdir(parents=True)
    np.save(file, levels)
    splats = SplatScene.create("vase", gaussians, bpy.context.scene.collection, membership=levels[0])
    obj = splats.object
    obj["heritage_count"] = _COUNT
    said = obj.heritage
    said.role, said.project, said.object_id, said.n_levels = "OBJECT", str(project), "vase", _LEVELS
    said.threshold = 0.5
    bpy.context.view_layer.update()
    return obj


def _cost(obj: Any, move: Callable[[int], None]) -> dict[str, Any]:
    """Return the median cost of a move, and what was drawn before the first and after the last."""
    import bpy

    drawn, costs = [_drawn(obj)], []
    for number in range(1, _REPEATS + 1):
        cpu, wall = time.process_time(), time.perf_counter()
        move(number)
        bpy.context.view_layer.update()
        costs.append((time.process_time() - cpu, time.perf_counter() - wall))
    drawn.append(_drawn(obj))
    if obj.heritage.problem or drawn[0] == drawn[1]:
        raise RuntimeError(f"The slider moved nothing: {obj.heritage.problem or drawn}")
    cpu, wall = np.median(costs, axis=0)
    return {"cpu": float(cpu), "wall": float(wall), "drawn": f"{drawn[0]:,}, {drawn[1]:,}"}


def _drawn(obj: Any) -> int:
    import bpy

    instances = bpy.context.evaluated_depsgraph_get().object_instances
    return sum(1 for instance in instances if instance.parent and instance.parent.original == obj)


if __name__ == "__main__":
    sys.exit(main())
