"""The import contracts hold, and each of them finds a violation that is planted."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts"))

from check_house import check_imports, link_repository  # noqa: E402

# file that gets a line, the line, the contract that must break
PLANTED = [
    ("engine/planning.py", "import bpy", "The engine never imports bpy"),
    ("engine/planning.py", "from ..operators import CLASSES", "The engine never imports bpy"),
    ("gaussian_heritage_addon/__init__.py", "import torch", "Inside Blender nothing imports torch"),
    ("operators/__init__.py", "from ..engine.rasterizer import cpu", "Inside Blender nothing imports torch"),
    ("engine/formats/ply.py", "import scipy", "imports only the standard library and NumPy"),
    ("engine/photos/reading.py", "from ..objects import storage", "photos -> cameras -> masks"),
    ("engine/masks/storage.py", "import numba", "numba and llvmlite stay in the rasterizer"),
    ("engine/training/train.py", "import pycolmap", "pycolmap stays in cameras"),
    ("engine/masks/storage.py", "import onnxruntime", "onnxruntime is imported by models.onnx_session alone"),
]


def test_the_house_keeps_its_contracts(tmp_path: Path) -> None:
    link_repository(tmp_path)
    done = check_imports(tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(("file", "line", "contract"), PLANTED, ids=[f"{line} in {file}" for file, line, _ in PLANTED])
def test_planted_violation_is_found(file: str, line: str, contract: str, tmp_path: Path) -> None:
    package = tmp_path / "gaussian_heritage"
    package.mkdir()
    for name in ("engine", "gaussian_heritage_addon", "operators"):
        shutil.copytree(ROOT / name, package / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "__init__.py", package)
    planted = package / file
    planted.write_text(f"{planted.read_text()}\n{line}\n")
    done = check_imports(tmp_path)
    assert done.returncode != 0
    broken = [row for row in done.stdout.splitlines() if row.endswith("BROKEN")]
    assert any(contract in row for row in broken), done.stdout
