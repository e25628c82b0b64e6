"""The packaged extension is small and complete, and can be installed."""

from __future__ import annotations

import importlib
import importlib.util
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import bpy

ALLOWED_TOP = {"blender_manifest.toml", "__init__.py", "LICENSE", "gaussian_heritage_addon", "engine", "operators"}


def test_zip_contains_only_the_extension(zip_file: Path) -> None:
    names = [name for name in zipfile.ZipFile(zip_file).namelist() if not name.endswith("/")]
    assert {Path(name).parts[0] for name in names} == ALLOWED_TOP
    assert not [name for name in names if "__pycache__" in name or name.endswith((".pyc", ".onnx", ".blend"))]
    assert not [name for name in names if any(part.startswith(".") or part == "tests" for part in Path(name).parts)]
    assert zip_file.stat().st_size <= 3e6


def test_zip_validates_with_blenders_own_tool(zip_file: Path) -> None:
    tool = Path(bpy.utils.system_resource("SCRIPTS")) / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"
    done = subprocess.run(
        [sys.executable, str(tool), "validate", str(zip_file)],
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_repository_is_not_importable_here() -> None:
    """Otherwise the repository could satisfy an import that is broken in the zip."""
    assert importlib.util.find_spec("engine") is None
    assert importlib.util.find_spec("operators") is None
    assert not [folder for folder in sys.path if (Path(folder) / "blender_manifest.toml").exists()]


def test_extension_installs_disables_and_enables_again(installed: str) -> None:
    bpy.ops.preferences.addon_disable(module=installed)
    assert installed not in bpy.context.preferences.addons
    assert not hasattr(bpy.types, "HERITAGE_OT_isolate")
    bpy.ops.preferences.addon_enable(module=installed)
    assert installed in bpy.context.preferences.addons
    assert bpy.ops.heritage.isolate.get_rna_type() is not None


INSTALL = """
import sys
import bpy
bpy.ops.extensions.package_install_files(filepath=sys.argv[1], repo="user_default", enable_on_install=True)
"""


def test_blender_ends_with_the_extension_enabled(zip_file: Path, tmp_path: Path) -> None:
    """References that outlive the extension, such as those in a cache of `typing`, make bpy 4.5 hang at its end."""
    environment = {**os.environ, "BLENDER_USER_RESOURCES": str(tmp_path)}
    command = [sys.executable, "-P", "-c", INSTALL, str(zip_file)]
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, errors="replace", check=False, timeout=600
    )
    assert done.returncode == 0 and "Not freed" not in done.stdout + done.stderr


def test_no_heavy_package_is_imported_in_blender(installed: str) -> None:
    importlib.import_module(installed)
    for file in importlib.import_module(installed).__path__:
        for module in sorted(Path(file).glob("operators/*.py")):
            importlib.import_module(f"{installed}.operators.{module.stem}".removesuffix(".__init__"))
    heavy = {"torch", "pycolmap", "onnxruntime", "cv2", "numba", "scipy", "PIL"}
    assert heavy & set(sys.modules) == set()
