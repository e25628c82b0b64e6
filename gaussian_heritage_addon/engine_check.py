"""Checks the engine's Python environment with ``python -m engine doctor``."""

from __future__ import annotations

from pathlib import Path

from ..engine.errors import EnvironmentProblem
from .engine_process import engine_command
from .jobs import Job
from .preferences import current_environment, current_python, user_folder

__all__ = ["check_engine"]


def check_engine() -> tuple[Path, list[str], list[str]]:
    """Return the interpreter, one line of text per check, and the names of missing requirements.

    Raises
    ------
    HeritageError
        When no interpreter is found, or the engine does not start with it.
    """
    python = current_python()
    state = Job.start(
        engine_command(python, "doctor"),
        user_folder("jobs") / "doctor",
        kind="doctor",
        subject=str(python),
        environment=current_environment(),
    ).wait()
    checks = state.outputs.get("checks")
    if not isinstance(checks, list) or not all(isinstance(check, dict) for check in checks):
        raise EnvironmentProblem(f"The engine does not start with {python}. {state.error}".strip())
    missing = [str(check.get("name")) for check in checks if check.get("required") and not check.get("ok")]
    return python, state.message.splitlines(), missing
