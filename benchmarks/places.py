"""The repository and its Python environments, as in ``scripts/places.py``, and scripts in Blender's Python."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "scripts"))

from places import blender_environments, python_of  # noqa: E402

__all__ = ["ROOT", "blender_environments", "python_of", "run_room_script"]

_ROOM_SCRIPTS = ROOT / "demo" / "random_rooms"


def run_room_script(name: str, *words: object) -> None:
    """Run a script of `demo/random_rooms` in Blender's Python, with these arguments."""
    command = [python_of("blender-4.5"), _ROOM_SCRIPTS / name, *words]
    subprocess.run([str(word) for word in command], check=True, stdout=subprocess.DEVNULL)
