"""Makes the repository importable as one package, like the installed extension in Blender, but without bpy."""

from __future__ import annotations

import sys
import types
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = "gaussian_heritage_without_blender"

# Empty parent packages: modules that need no bpy can be imported without running the add-on's __init__, which needs it.
for name in (PACKAGE, f"{PACKAGE}.gaussian_heritage_addon"):
    module = types.ModuleType(name)
    module.__path__ = [str(ROOT.joinpath(*name.split(".")[1:]))]
    sys.modules.setdefault(name, module)


@pytest.fixture
def script(tmp_path: Path) -> Callable[[str], list[str]]:
    """Return a function that turns Python source into a command. The source may print events with ``say(event)``."""

    def make(text: str) -> list[str]:
        file = tmp_path / "script.py"
        head = "import sys, time, signal\nfrom engine.events import *\n"
        # As the engine does: a process started with & in a shell ignores SIGINT by default.
        head += "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        head += "def say(event): print(to_json_line(event), flush=True)\n"
        file.write_text(head + text)
        return [sys.executable, str(file)]

    return make
