"""Where this house keeps its environments and how their Python is called. Standard library only.

The scripts beside this file start before any environment exists, so none of them may import more than that.
"""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["PACKAGES", "ROOT", "blender_environments", "environment_folder", "python_of"]

ROOT = Path(__file__).resolve().parent.parent

PACKAGES = ("engine", "gaussian_heritage_addon", "operators")
"""The packages that travel in the extension."""


def environment_folder(name: str) -> Path:
    """Return the folder of an environment, ``.venv/<name>`` unless GAUSSIAN_HERITAGE_VENVS names another place."""
    return Path(os.environ.get("GAUSSIAN_HERITAGE_VENVS") or ROOT / ".venv") / name


def python_of(name: str) -> Path:
    """Return the Python of an environment, which need not exist yet."""
    return environment_folder(name) / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def blender_environments() -> list[str]:
    """Return the Blender environments whose tests must run: 4.5 always, 5.2 where it was made."""
    return ["blender-4.5"] + (["blender-5.2"] if python_of("blender-5.2").exists() else [])
