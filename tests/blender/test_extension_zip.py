"""The extension as it is given away: small, complete, and it installs."""

from __future__ import annotations

import importlib
import importlib.util
import subprocess
import sys
import zipfile
from pathlib import Path

import bpy

ALLOWED_TOP = {"blender_manifest.toml", "__init__.py", "LICENSE", "gaussian_heritage_addon", "engine", "operators"}


def test_zip_holds_only_what_it_should(zip_file: Path) -> None:
    names = [name for name in zipfile.ZipFile(zip_file).namelist() if not name.endswith("/")]
    assert {Path(name).parts[0] for name in names} == ALLOWED_TOP
    assert not [name for name in names if "__pycache__" in name or name.endswith((".pyc", ".onnx", ".blend"))]
    assert not [name for name in names if any(part.startswith(".") or part == "tests" for part in Path(name).parts)]
    assert zip_file.stat().st_size <= 3e6


def test_zip_validates_with_blenders_own_tool(zip_file: Path) -> None:
    tool = Path(bpy.utils.system_resource("SCRIPTS")) / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"
    done = subprocess.run(
        [sys.executable, str(tool), "validate", str(zip_file)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_repository_is_not_importable_here() -> None:
    """Else a relative import that is wrong in the zip could be answered by the repository."""
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


def test_nothing_heavy_enters_blenders_process(installed: str) -> None:
    importlib.import_module(installed)
    for file in importlib.import_module(installed).__path__:
        for module in sorted(Path(file).glob("operators/*.py")):
            importlib.import_module(f"{installed}.operators.{module.stem}".removesuffix(".__init__"))
    heavy = {"torch", "pycolmap", "onnxruntime", "cv2", "numba", "scipy", "PIL"}
    assert heavy & set(sys.modules) == set()
