"""Fixtures of the tests in Blender (bpy from PyPI), which use the installed zip; see scripts/run_blender_tests.py."""

from __future__ import annotations

import atexit
import ctypes
import importlib
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

# Blender reads its user folder when bpy is imported. An empty one keeps the user's own add-ons out of the tests.
_RESOURCES = tempfile.mkdtemp(prefix="gaussian-heritage-blender-")
os.environ["BLENDER_USER_RESOURCES"] = _RESOURCES
atexit.register(shutil.rmtree, _RESOURCES, ignore_errors=True)

import bpy  # noqa: E402

MODULE = "bl_ext.user_default.gaussian_heritage"


_status: list[int] = []


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """Keep the result of the run for `pytest_unconfigure`."""
    _status.append(int(exitstatus))


def pytest_unconfigure(config: pytest.Config) -> None:
    """End at once: Blender 4.5 as a Python module does not end after a step was undone, and may crash under Wine."""
    if _status:
        shutil.rmtree(_RESOURCES, ignore_errors=True)
        sys.stdout.flush()
        sys.stderr.flush()
        if os.name == "nt":
            # `os._exit` would still let Blender's libraries clean up.
            ctypes.windll.kernel32.TerminateProcess(ctypes.c_void_p(-1), _status[-1])
        os._exit(_status[-1])


@pytest.fixture(scope="session")
def zip_file() -> Path:
    """Return the built extension."""
    return Path(os.environ["GAUSSIAN_HERITAGE_ZIP"])


@pytest.fixture(scope="session")
def installed(zip_file: Path) -> str:
    """Install and enable the extension as a user does, and return its module name."""
    bpy.ops.extensions.package_install_files(filepath=str(zip_file), repo="user_default", enable_on_install=True)
    assert MODULE in bpy.context.preferences.addons
    return MODULE


@pytest.fixture(scope="session")
def start_up_file(installed: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a file that holds nothing but the node groups of the display, which the add-on builds here once.

    Blender updates a whole tree for each of its links, so that building one takes most of the time of a test. Two
    tests show degree 2, which the others would have to read.
    """
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=False)
    add_display = importlib.import_module(f"{installed}.gaussian_heritage_addon.splats.splat_nodes").add_display
    obj = bpy.data.objects.new("shown", bpy.data.meshes.new("shown"))
    for sh_degree in (0, 1, 3):
        add_display(obj, sh_degree)
    for group in bpy.data.node_groups:
        group.use_fake_user = True
    bpy.data.meshes.remove(obj.data)
    file = tmp_path_factory.mktemp("start up") / "start_up.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(file), copy=True)
    return file


@pytest.fixture
def blender(start_up_file: Path) -> Iterator[ModuleType]:
    """Open a file without objects, with the extension enabled, and yield bpy."""
    bpy.ops.wm.read_homefile(filepath=str(start_up_file), use_factory_startup=False)
    yield bpy
