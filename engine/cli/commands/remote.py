"""``remote``: another command on the workers of a Dask cluster, with its progress here."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...core.errors import EnvironmentProblem, SettingsError
from ...core.events import Emit, StopCheck
from . import frames, reconstruct, segment

NAME = "remote"
HELP = "Run reconstruct, segment or frames on the workers of a Dask cluster that share the folders."
EXAMPLE = "python -m engine remote --scheduler tcp://head:8786 -- segment /scans/room --prompt vase"
_COMMANDS = {module.NAME: module for module in (frames, reconstruct, segment)}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("--scheduler", required=True, metavar="ADDRESS", help="Dask scheduler, e.g. tcp://head:8786")
    parser.add_argument("words", nargs="+", metavar="COMMAND ...", help="after --: the command, with absolute paths")


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Run the command, and return 0 when it has succeeded."""
    name, *words = options.words
    if name not in _COMMANDS:
        raise SettingsError(f"remote runs {', '.join(_COMMANDS)}, and {name!r} is none of them.")
    parser = argparse.ArgumentParser(prog=f"python -m engine {name}")
    _COMMANDS[name].add_arguments(parser)
    parsed = parser.parse_args(words)
    project: Path = getattr(parsed, getattr(_COMMANDS[name], "LOG_IN", "out"))
    try:
        from ...workers.batch import BatchSettings, run_remote_job
    except ModuleNotFoundError as error:
        raise EnvironmentProblem(
            f"The package {error.name} is missing, which clusters need. Install requirements/batch.txt with pip."
        ) from error
    settings = BatchSettings(out=project.parent, scheduler=options.scheduler)
    run_remote_job(options.words, project, settings, emit=emit, should_stop=should_stop)
    return 0
