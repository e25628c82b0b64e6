"""One job of the engine, started, polled and cancelled as Blender does it. Runs on Windows' Python, without bpy.

    python engine_job.py REQUEST.json

The request is a JSON object: ``extension`` (folder of the installed add-on), ``command`` (command line, without its
last word ``--events``), ``folder`` (of the job's files), ``kernels`` (folder for compiled kernels), ``cancel_at``
(stage and part of it after which it is cancelled, or null), ``grace`` (seconds until a cancelled job is killed). Prints
the state at the end as JSON.
"""

import dataclasses
import importlib
import inspect
import json
import os
import sys
import time
import types
from pathlib import Path
from typing import Any

_POLL_SECONDS = 0.5
"""As often as Blender asks."""


def _module(name: str, extension: Path) -> Any:
    """Return a module of the add-on; its packages are stood in for, because their own start needs bpy."""
    package = extension.name
    for parent in (package, f"{package}.gaussian_heritage_addon"):
        if parent not in sys.modules:
            stand_in = types.ModuleType(parent)
            stand_in.__path__ = [str(extension.joinpath(*parent.split(".")[1:]))]
            sys.modules[parent] = stand_in
    return importlib.import_module(f"{package}.{name}")


def main() -> int:
    """Run the job and print how it ended."""
    request = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    extension = Path(request["extension"])
    process = _module("gaussian_heritage_addon.setup.engine_process", extension)
    jobs = _module("engine.workers.jobs", extension)
    given = {"environ": os.environ, "root": extension, "cache": Path(request["kernels"])}
    wanted = inspect.signature(process.engine_environment).parameters
    environment = process.engine_environment(**{name: given[name] for name in wanted})
    command = [*request["command"], "--events"]
    job = jobs.Job.start(
        command, Path(request["folder"]), kind="windows-test", subject=request["folder"], environment=environment
    )
    cancel_at = request["cancel_at"]
    cancelled_at = None
    while (state := job.poll()).running:
        if cancel_at and cancelled_at is None and state.stage == cancel_at[0] and state.fraction >= cancel_at[1]:
            cancelled_at = state.fraction
            job.cancel(request["grace"])
        time.sleep(_POLL_SECONDS)
    answer = {**dataclasses.asdict(state), "cancelled_at": cancelled_at, "curve": []}
    print("STATE " + json.dumps(answer, default=str))
    return 0


if __name__ == "__main__":
    sys.exit(main())
