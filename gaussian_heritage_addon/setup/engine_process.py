"""The Python interpreter, environment variables and command line of an engine process. Does not import bpy."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ...engine.core import engine_process as process
from ...engine.core.errors import EnvironmentProblem
from ...engine.core.system import python_in, unsupported
from ...engine.install.environment import EngineEnvironment

PYTHON_VARIABLE = "GAUSSIAN_HERITAGE_PYTHON"
"""Environment variable with the path of the engine's Python."""
_PROBLEMS = {
    "missing": "The engine is not set up yet. Press Set Up Engine",
    "incomplete": "The set-up of the engine is not complete. Press Continue Set-Up",
    "outdated": "The engine was set up by another version of this add-on. Press Update Engine",
}


def find_python(preferred: str, environ: Mapping[str, str], root: Path, installed: EngineEnvironment) -> Path:
    """Return the engine's interpreter.

    It is `preferred`, else that of the environment variable, else ``.venv/engine`` in a checkout, else the one that was
    set up from Blender.

    Parameters
    ----------
    preferred : str
        Path set in the preferences; empty when not set.
    environ : mapping
        Environment variables, searched for ``GAUSSIAN_HERITAGE_PYTHON``.
    root : Path
        The folder of this extension. Where it is a checkout of the repository, ``.venv/engine`` in it is used. Folders
        above it are not searched: others may be able to put a program there, and it would be run.
    installed : EngineEnvironment
        The engine that was set up from Blender.

    Raises
    ------
    EnvironmentProblem
        When no interpreter is found, the configured one does not exist, or the installed one is not complete.
    """
    for source, path in (("the preferences", preferred), (PYTHON_VARIABLE, environ.get(PYTHON_VARIABLE, ""))):
        if path:
            # Links are not resolved: Python recognises a virtual environment by the path of the link.
            python = Path(path).expanduser().absolute()
            if python.is_file():
                return python
            raise EnvironmentProblem(f"The engine's Python set in {source} does not exist: {path}. Choose another one.")
    python = python_in(root / ".venv" / "engine")
    if python.is_file():
        return python
    state = installed.state()
    if state == "ready":
        return installed.python
    if problem := unsupported():
        raise EnvironmentProblem(problem)
    raise EnvironmentProblem(f"{_PROBLEMS[state]} in the sidebar or in Preferences > Add-ons > Gaussian Heritage.")


def engine_environment(environ: Mapping[str, str], root: Path) -> dict[str, str]:
    """Return the environment variables of an engine process.

    Parameters
    ----------
    environ : mapping
        Environment variables of this process.
    root : Path
        Value of PYTHONPATH, so that ``python -m engine`` runs the engine of this extension.
    """
    own = process.engine_environment(environ, root=root, other_python=True)
    return {**own, "PYTHONUNBUFFERED": "1", "PYTHONDONTWRITEBYTECODE": "1"}


def engine_command(python: Path, *arguments: str) -> list[str]:
    """Return the command line that runs the engine with `arguments` and ``--events``."""
    return process.engine_command(*arguments, "--events", python=python)
