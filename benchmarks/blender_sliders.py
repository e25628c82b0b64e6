"""Response time of the sliders in Blender: ``python -m benchmarks.blender_sliders [--out FILE.md]``.

An object of 300,000 Gaussians is created in each installed Blender, then its membership threshold and its level (part
to whole) are changed. The time runs from setting the property until the depsgraph has the new instances. Nothing is
rendered. The goal is 0.2 s.

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

_COUNT = 300_000
"""Number of Gaussians of the object."""

_LEVELS = 3
"""Number of levels between part and whole."""

_REPEATS = 10
"""Number of changes of each slider."""

_HEAD = f"""# Response time of the sliders in Blender

Written by `python -m benchmarks.blender_sliders --out docs/blender_sliders.md`. The times run from changing a property
of an object with {_COUNT:,} Gaussians until Blender has the new instances, medians of {_REPEATS} changes. The goal is
0.2 s.

| Blender | slider | CPU s | wall s | instances before, after |
| --- | --- | ---: | ---: | --- |
"""


def main() -> int:
    """Measure in each Blender and print the table, and write it to the file given by ``--out``."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="Markdown file for the table")
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.here:
        _measure_and_exit()
    text = _HEAD
    for name in blender_environments():
        command = [str(python_of(name)), "-m", "benchmarks.blender_sliders", "--here"]
        process = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        if process.returncode:
            print(f"{name}: {process.stderr.strip().splitlines()[-1]}", file=sys.stderr)
            return 1
        for row in json.loads(process.stdout.splitlines()[-1]):
            text += (
                f"| {row['blender']} | {row['slider']} | {row['cpu']:.3f} | {row['wall']:.3f} | {row['instances']} |\n"
            )
    print(text)
    if arguments.out:
        arguments.out.write_text(text, encoding="utf-8")
    return 0


def _measure_and_exit() -> NoReturn:
    """Print the measurements of this Blender as JSON and end the process."""
    code = 1
    try:
        print(json.dumps(measure()), flush=True)
        code = 0
    except Exception as error:
        print(repr(error), file=sys.stderr, flush=True)
    # Blender's clean-up waits forever if references to its data are left, as after an error.
    os._exit(code)


def measure() -> list[dict[str, Any]]:
    """Return one row of the table for each slider, measured in the Blender of this process."""
    import bpy

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        link_repository(folder)
        sys.path.insert(0, str(folder))
        import gaussian_heritage  # type: ignore[import-not-found]

        gaussian_heritage.register()
        bpy.ops.wm.read_homefile(use_empty=True)
        obj = _create_object(folder / "project")
        properties = obj.heritage

        def set_threshold(number: int) -> None:
            properties.threshold = 0.3 + 0.05 * (number % 8)

        def set_level(number: int) -> None:
            properties.part_to_whole = number % _LEVELS / (_LEVELS - 1)

        version = ".".join(map(str, bpy.app.version))
        return [
            {"blender": version, "slider": slider, **_cost(obj, change)}
            for slider, change in (("threshold", set_threshold), ("part to whole", set_level))
        ]


def _create_object(project: Path) -> Any:
    """Return an isolated object of a project whose levels are stored on the disk."""
    import bpy
    from gaussian_heritage.engine.scene import Gaussians
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
    properties = obj.heritage
    properties.role, properties.project, properties.object_id = "OBJECT", str(project), "vase"
    properties.n_levels = _LEVELS
    properties.threshold = 0.5
    bpy.context.view_layer.update()
    return obj


def _cost(obj: Any, change: Callable[[int], None]) -> dict[str, Any]:
    """Return the median CPU and wall seconds of a change, and the instances before the first and after the last one."""
    import bpy

    instances, costs = [_n_instances(obj)], []
    for number in range(1, _REPEATS + 1):
        cpu, wall = time.process_time(), time.perf_counter()
        change(number)
        bpy.context.view_layer.update()
        costs.append((time.process_time() - cpu, time.perf_counter() - wall))
    instances.append(_n_instances(obj))
    if obj.heritage.problem or instances[0] == instances[1]:
        raise RuntimeError(f"The slider changed nothing: {obj.heritage.problem or instances}")
    cpu, wall = np.median(costs, axis=0)
    return {"cpu": float(cpu), "wall": float(wall), "instances": f"{instances[0]:,}, {instances[1]:,}"}


def _n_instances(obj: Any) -> int:
    """Return how many instances Blender draws of an object."""
    import bpy

    instances = bpy.context.evaluated_depsgraph_get().object_instances
    return sum(1 for instance in instances if instance.parent and instance.parent.original == obj)


if __name__ == "__main__":
    sys.exit(main())
