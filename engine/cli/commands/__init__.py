"""The commands of ``python -m engine``, one module each: name, help, example, arguments and `run`.

``LOG_IN`` names the argument that is the project whose log is written.
"""

from __future__ import annotations

import importlib
import importlib.util
from types import ModuleType

COMMANDS: tuple[str, ...] = (
    "plan", "frames", "reconstruct", "segment", "ask", "show-clicks", "vocabulary", "edit", "trash", "measure",
    "export", "package", "verify", "turntable", "render", "report", "models", "doctor", "serve", "batch", "remote",
)  # fmt: skip
"""Names of the commands, in the order of the help."""

# Commands that measure the engine; the extension's zip goes without what they need.
if importlib.util.find_spec("...quality", __package__) is not None:
    COMMANDS = (*COMMANDS, "evaluate", "bench", "stability")


def load_command(name: str) -> ModuleType:
    """Return the module of a command, which is called like it. The others are not imported: they cost start-up time."""
    return importlib.import_module(f".{name.replace('-', '_')}", __package__)
