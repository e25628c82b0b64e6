"""What the preferences say: which Python runs the engine, which models it uses. Their page is `preferences_page`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import bpy

from ..engine.masks.settings import SAM_MODELS
from .engine_process import engine_environment, extension_root, find_python
from .model_files import States, merged_states

__all__ = [
    "BASE_PACKAGE",
    "current_environment",
    "current_python",
    "model_folder",
    "remember_check",
    "remember_models",
    "sam_arguments",
    "user_folder",
]

BASE_PACKAGE = __package__.rpartition(".")[0]


def _preferences() -> Any:
    return bpy.context.preferences.addons[BASE_PACKAGE].preferences


def remember_check(result: str) -> None:
    """Show the result of a check in the preferences."""
    _preferences().check_result = result


def remember_models(states: States) -> None:
    """Show which model files are there."""
    _preferences().model_states = merged_states(_preferences().model_states, states)


def model_folder() -> str:
    """Return the folder that model files are taken from instead of the network; empty for none."""
    return bpy.path.abspath(_preferences().model_folder)


def sam_arguments() -> list[str]:
    """Return the arguments of ``segment`` that name the Segment Anything model, none for the usual one."""
    chosen = _preferences().sam
    return [] if chosen == SAM_MODELS[0] else ["--sam", chosen]


def current_python() -> Path:
    """Return the engine's Python; `EnvironmentProblem` when there is none."""
    return find_python(_preferences().engine_python, os.environ, extension_root())


def current_environment() -> dict[str, str]:
    """Return the surroundings of an engine process."""
    return engine_environment(os.environ, extension_root(), user_folder("numba"))


def user_folder(name: str) -> Path:
    """Return a folder for files of ours that outlives upgrades of the extension."""
    return Path(bpy.utils.extension_path_user(BASE_PACKAGE, path=name, create=True))
