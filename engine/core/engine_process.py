"""The command line, environment variables and events of a process of the engine, whoever starts it."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO

from .events import Event, from_json_line
from .system import CODE_ROOT, with_utf8

__all__ = ["engine_command", "engine_environment", "events_in"]

_MAX_LINE = 1 << 20
"""Bytes of a line that is read. Of longer ones no part is an event."""


def engine_command(*arguments: object, python: Path | None = None, module: str = "engine") -> list[str]:
    """Return the command line that runs a module of the engine, with the variables of `engine_environment`.

    Parameters
    ----------
    *arguments : object
        Arguments of the module, as text.
    python : Path, optional
        Another Python than that of this process.
    module : str
    """
    return [str(python or sys.executable), "-m", module, *map(str, arguments)]


def engine_environment(
    environ: Mapping[str, str] | None = None, *, root: Path = CODE_ROOT, other_python: bool = False
) -> dict[str, str]:
    """Return the environment variables of a process of the engine.

    Parameters
    ----------
    environ : mapping, optional
        By default, those of this process.
    root : Path
        Folder that contains the engine's package: it comes first in PYTHONPATH.
    other_python : bool
        Whether the process has another Python than this one, e.g. than Blender's. It writes UTF-8 then, and gets none
        of the modules that this process finds.
    """
    kept = dict(os.environ if environ is None else environ)
    paths = [str(root), *filter(None, [kept.get("PYTHONPATH")])]
    if other_python:
        # Blender may set PYTHONHOME to its own Python; another interpreter cannot start with it.
        kept.pop("PYTHONHOME", None)
        kept, paths = with_utf8(kept), paths[:1]
    # PYTHONSAFEPATH: a file in the current folder must not pass for a module of ours.
    return {**kept, "PYTHONPATH": os.pathsep.join(paths), "PYTHONSAFEPATH": "1"}


def events_in(stream: IO[bytes]) -> Iterator[Event]:
    """Yield the events that a process of the engine writes to its standard output; other lines are passed over."""
    while line := stream.readline(_MAX_LINE):
        event = from_json_line(line.decode("utf-8", "replace"))
        if event is not None:
            yield event
