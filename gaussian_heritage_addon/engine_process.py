"""Which Python runs the engine, and in what surroundings. No bpy."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from ..engine.errors import EnvironmentProblem

__all__ = ["PYTHON_VARIABLE", "engine_command", "engine_environment", "extension_root", "find_python"]

PYTHON_VARIABLE = "GAUSSIAN_HERITAGE_PYTHON"


def extension_root() -> Path:
    """Return the folder that holds ``engine``: the installed extension, or the repository."""
    return Path(__file__).resolve().parent.parent


def find_python(chosen: str, environ: Mapping[str, str], root: Path) -> Path:
    """Return the engine's interpreter: the chosen one, else the environment variable's, else ``.venv/engine``.

    Parameters
    ----------
    chosen : str
        From the preferences; empty when the person chose none.
    environ : mapping
        ``GAUSSIAN_HERITAGE_PYTHON`` is looked up here.
    root : Path
        ``.venv/engine`` is looked for here and in the folders above.

    Raises
    ------
    EnvironmentProblem
        When there is none, or the named one is not there.
    """
    for source, named in (("the preferences", chosen), (PYTHON_VARIABLE, environ.get(PYTHON_VARIABLE, ""))):
        if named:
            # Not resolved: a virtual environment's python is a link, and its own path is what makes it one.
            python = Path(named).expanduser().absolute()
            if python.is_file():
                return python
            raise EnvironmentProblem(
                f"The engine's Python named in {source} is not there: {named}. Choose another one."
            )
    for python in _development_pythons(root):
        if python.is_file():
            return python
    raise EnvironmentProblem(
        "No Python for the engine is known. Open Preferences > Add-ons > Gaussian Heritage, choose the Python of the "
        "engine's environment and press Check."
    )


def _development_pythons(root: Path) -> Iterable[Path]:
    executable = "Scripts/python.exe" if os.name == "nt" else "bin/python"
    return (folder / ".venv" / "engine" / executable for folder in (root, *root.parents))


def engine_environment(environ: Mapping[str, str], root: Path, cache: Path) -> dict[str, str]:
    """Return the surroundings of an engine process.

    Parameters
    ----------
    environ : mapping
        Of this process.
    root : Path
        Becomes PYTHONPATH, so that ``python -m engine`` finds this extension's engine and no other.
    cache : Path
        For compiled kernels: outside the extension, which an upgrade replaces.
    """
    # Blender may set PYTHONHOME to its own Python, with which another interpreter cannot start.
    kept = {name: value for name, value in environ.items() if name not in ("PYTHONHOME", "PYTHONPATH")}
    return {
        **kept,
        "PYTHONPATH": str(root),
        "PYTHONUNBUFFERED": "1",
        "PYTHONIOENCODING": "utf-8",
        "PYTHONDONTWRITEBYTECODE": "1",
        "NUMBA_CACHE_DIR": str(cache),
    }


def engine_command(python: Path, *arguments: str) -> list[str]:
    """Return the command line of the engine with ``--events``."""
    return [str(python), "-m", "engine", *arguments, "--events"]
