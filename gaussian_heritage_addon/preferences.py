"""The add-on's preferences: which Python runs the engine."""

from __future__ import annotations

import os
from pathlib import Path

import bpy

from .engine_process import engine_environment, extension_root, find_python

__all__ = ["BASE_PACKAGE", "CLASSES", "HeritagePreferences", "current_environment", "current_python", "user_folder"]

BASE_PACKAGE = __package__.rpartition(".")[0]


class HeritagePreferences(bpy.types.AddonPreferences):
    """Which Python runs the engine, and a way to check it."""

    bl_idname = BASE_PACKAGE

    engine_python: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Engine Python",
        description="Python of the engine's environment; empty: the one in GAUSSIAN_HERITAGE_PYTHON or .venv/engine",
        subtype="FILE_PATH",
    )
    check_result: bpy.props.StringProperty(options={"SKIP_SAVE"})  # type: ignore[valid-type]

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the preferences."""
        layout = self.layout
        layout.prop(self, "engine_python")
        layout.operator("heritage.check_engine", icon="CHECKMARK")
        for line in self.check_result.splitlines():
            layout.label(text=line)


def _preferences() -> HeritagePreferences:
    return bpy.context.preferences.addons[BASE_PACKAGE].preferences


def remember_check(result: str) -> None:
    """Show the result of a check in the preferences."""
    _preferences().check_result = result


def current_python() -> Path:
    """Return the engine's Python; `EnvironmentProblem` when there is none."""
    return find_python(_preferences().engine_python, os.environ, extension_root())


def current_environment() -> dict[str, str]:
    """Return the surroundings of an engine process."""
    return engine_environment(os.environ, extension_root(), user_folder("numba"))


def user_folder(name: str) -> Path:
    """Return a folder for files of ours that outlives upgrades of the extension."""
    return Path(bpy.utils.extension_path_user(BASE_PACKAGE, path=name, create=True))


CLASSES = [HeritagePreferences]
