"""Paths of the repository, its Python environments and their interpreters.

Standard library only, because the scripts that import this module run before any environment exists.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))
from engine.core.system import program_in, python_in  # noqa: E402 it imports the standard library alone

PACKAGES = ("engine", "gaussian_heritage_addon", "operators")
"""The packages of the extension."""
BLENDERS = {"4.5": (3, 11), "5.2": (3, 13), "5.3": (3, 13)}
"""The versions of Blender in which the add-on is tested, and the Python of each: the only list of them.

The first builds the extension and must be there. The others are tested where their Python is found."""


def environment_folder(name: str) -> Path:
    """Return the folder of an environment: ``.venv/<name>``, or ``$GAUSSIAN_HERITAGE_VENVS/<name>`` if it is set."""
    return Path(os.environ.get("GAUSSIAN_HERITAGE_VENVS") or ROOT / ".venv") / name


def python_of(name: str) -> Path:
    """Return the path of an environment's Python, which need not exist."""
    return python_in(environment_folder(name))


def program_of(name: str, program: str) -> Path:
    """Return the path of a program of an environment."""
    return program_in(environment_folder(name), program)


def blender_environments() -> list[str]:
    """Return the Blender environments to test: the first of `BLENDERS` always, the others when they exist."""
    first, *others = (f"blender-{version}" for version in BLENDERS)
    return [first, *(name for name in others if python_of(name).exists())]
