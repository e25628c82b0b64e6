"""Access to the preferences: the engine's Python and models. `preferences_page` defines and draws them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import bpy

from ...engine.core.errors import EnvironmentProblem, HeritageError
from ...engine.core.files import delete_derived, read_after_change, read_json, write_json
from ...engine.core.system import CODE_ROOT
from ...engine.masks.settings import SAM_MODELS
from .engine_process import engine_environment, find_python
from .installation import installed_engine
from .model_files import States, merge_states

BASE_PACKAGE = __package__.rsplit(".", 2)[0]
"""Name of the extension's package, by which Blender identifies its preferences."""
_PROBLEM = "set_up.json"
"""File that says why a set-up failed, in the folder ``log`` of the user's files."""


def _preferences() -> Any:
    return bpy.context.preferences.addons[BASE_PACKAGE].preferences


def store_check_result(result: str) -> None:
    """Store the result of an engine check, to show it in the preferences."""
    _preferences().check_result = result


def store_model_states(states: States) -> None:
    """Store the states of model files, to show them in the preferences."""
    _preferences().model_states = merge_states(_preferences().model_states, states)


def model_folder() -> str:
    """Return the folder with model files to use instead of the network; empty when not set."""
    return bpy.path.abspath(_preferences().model_folder)


def sam_arguments() -> list[str]:
    """Return the arguments of ``segment`` that select the Segment Anything model; none for the default."""
    model = _preferences().sam
    return [] if model == SAM_MODELS[0] else ["--sam", model]


def set_up_options() -> tuple[str, str, str]:
    """Return how the engine is set up: Python (empty: any), build of torch, and offline bundle (empty: none)."""
    preferences = _preferences()
    python, bundle = (bpy.path.abspath(path) for path in (preferences.base_python, preferences.offline_bundle))
    return python, preferences.torch_build.lower(), bundle


def engine_problem() -> str:
    """Return why there is no engine to work with, as a sentence; empty when there is one."""
    try:
        current_python()
    except EnvironmentProblem as error:
        return str(error)
    return ""


def set_up_problem() -> str:
    """Return why the last set-up of the engine failed, also in an earlier session of Blender; empty if it did not."""
    return _stored_problem(user_folder("log"))


def store_set_up_problem(problem: str) -> None:
    """Store why a set-up failed; empty when it did not.

    Raises
    ------
    DiskError
        When it cannot be written.
    """
    folder = user_folder("log")
    if problem:
        write_json(folder / _PROBLEM, {"problem": problem})
    else:
        delete_derived(folder, _PROBLEM)


@read_after_change(_PROBLEM)
def _stored_problem(folder: Path) -> str:
    try:
        problem: str = read_json(folder / _PROBLEM, {"problem": str}, advice="")["problem"]
    except HeritageError:
        return ""
    return problem


def current_python() -> Path:
    """Return the engine's Python.

    Raises
    ------
    EnvironmentProblem
        When none is found.
    """
    return find_python(bpy.path.abspath(_preferences().engine_python), os.environ, CODE_ROOT, installed_engine())


def current_environment() -> dict[str, str]:
    """Return the environment variables of an engine process."""
    return engine_environment(os.environ, CODE_ROOT)


def user_folder(name: str) -> Path:
    """Return a folder for files of the add-on that upgrades of the extension keep."""
    return Path(bpy.utils.extension_path_user(BASE_PACKAGE, path=name, create=True))
