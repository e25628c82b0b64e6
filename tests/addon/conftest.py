"""The repository seen as one package, as Blender sees the installed extension, but without bpy."""

from __future__ import annotations

import sys
import types
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = "gaussian_heritage_without_blender"

# The package's parts that need no bpy are imported by name; the add-on's own __init__, which needs it, is stepped over.
for name in (PACKAGE, f"{PACKAGE}.gaussian_heritage_addon"):
    module = types.ModuleType(name)
    module.__path__ = [str(ROOT.joinpath(*name.split(".")[1:]))]
    sys.modules.setdefault(name, module)


@pytest.fixture
def script(tmp_path: Path) -> Callable[[str], list[str]]:
    """Make a command that runs a Python text, with the engine's events at hand as ``say``."""

    def make(text: str) -> list[str]:
        file = tmp_path / "script.py"
        head = "import sys, time, signal\nfrom engine.events import *\n"
        # As the engine does: what is started behind a shell's & ignores SIGINT unless it asks for it.
        head += "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        head += "def say(event): print(to_json_line(event), flush=True)\n"
        file.write_text(head + text)
        return [sys.executable, str(file)]

    return make
