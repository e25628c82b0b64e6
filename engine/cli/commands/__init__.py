"""The commands of ``python -m engine``, one module each: name, help, example, arguments and `run`.

``LOG_IN`` names the argument that is the project whose log is written.
"""

from __future__ import annotations

import importlib.util
from types import ModuleType

from . import (
    batch,
    doctor,
    edit,
    export,
    frames,
    measure,
    models,
    package,
    plan,
    reconstruct,
    remote,
    render,
    report,
    segment,
    serve,
    show_clicks,
    trash,
    turntable,
    verify,
    vocabulary,
)

__all__ = ["COMMANDS"]

COMMANDS: tuple[ModuleType, ...] = (
    plan,
    frames,
    reconstruct,
    segment,
    show_clicks,
    vocabulary,
    edit,
    trash,
    measure,
    export,
    package,
    verify,
    turntable,
    render,
    report,
    models,
    doctor,
    serve,
    batch,
    remote,
)

# Commands that measure the engine; the extension's zip goes without what they need.
if importlib.util.find_spec("...quality", __package__) is not None:
    from . import bench, evaluate, stability

    COMMANDS = (*COMMANDS, evaluate, bench, stability)
