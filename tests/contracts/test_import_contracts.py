"""The import contracts see every package and find planted violations; `make contracts` checks that they hold."""

from __future__ import annotations

import configparser
import re
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT

sys.path.insert(0, str(ROOT / "scripts"))

from check_contracts import check_imports, copy_code  # noqa: E402
from places import PACKAGES  # noqa: E402

CONTRACTS = configparser.ConfigParser()
CONTRACTS.read(ROOT / ".importlinter", encoding="utf-8")
NAMES = {
    section.removeprefix("importlinter:contract:"): CONTRACTS[section]["name"]
    for section in CONTRACTS.sections()
    if section.startswith("importlinter:contract:")
}

# contract, the file that is planted, its line
PLANTED = [
    ("parts-in-order", "engine/photos/planted.py", "from ...operators import register"),
    ("parts-in-order", "engine/core/planted.py", "from ...gaussian_heritage_addon import register"),
    ("parts-in-order", "gaussian_heritage_addon/planted.py", "from ..operators import register"),
    ("parts-in-order", "engine/photos/planted.py", "from ..delivery.report import build"),
    ("parts-in-order", "engine/rasterizer/planted.py", "def late():\n    from ..training import train"),
    ("parts-in-order", "engine/training/planted.py", "from ..quality.stability import measure"),
    ("parts-in-order", "engine/install/models/planted.py", "from ...masks import sam"),
    ("add-on-in-order", "gaussian_heritage_addon/splats/planted.py", "from ..project import scene_file"),
    ("engine-without-blender", "engine/formats/planted.py", "import bpy"),
    ("blender-stays-light", "gaussian_heritage_addon/planted.py", "import cv2"),
    ("blender-stays-light", "operators/planted.py", "from ..engine.rasterizer import cpu"),
    ("blender-stays-light", "engine/formats/planted.py", "import scipy.spatial"),
    ("numba-in-rasterizer", "engine/masks/planted.py", "import numba"),
    ("web-in-serve", "engine/delivery/report/planted.py", "import fastapi"),
    ("mesh-libraries-in-meshing", "engine/delivery/report/planted.py", "import xatlas"),
    ("rocrate-in-packages", "engine/delivery/report/planted.py", "import rocrate"),
    ("dask-in-batch", "engine/delivery/report/planted.py", "import distributed"),
    ("pycolmap-in-cameras", "engine/training/planted.py", "import pycolmap"),
    ("onnxruntime-in-one-module", "engine/install/models/planted.py", "import onnxruntime"),
    ("torch-where-gradients-are", "engine/cameras/planted.py", "from torch import nn"),
    ("relative-imports", "engine/delivery/report/planted.py", "from engine.core.errors import HeritageError"),
    ("relative-imports", "gaussian_heritage_addon/planted.py", "import engine.core.events"),
    ("public-faces", "engine/delivery/report/planted.py", "from ...cameras.sfm import estimate_cameras"),
    ("public-faces", "engine/delivery/report/planted.py", "from ..records.lido import lido_xml"),
    ("public-faces", "gaussian_heritage_addon/planted.py", "from ..engine.scene.camera import Camera"),
]

CIRCLES = {
    "operators/circle_a.py": "from .circle_b import b",
    "operators/circle_b.py": "from .circle_a import a",
}


def test_every_contract_has_a_planted_violation() -> None:
    assert {contract for contract, _, _ in PLANTED} | {"no-circles"} == set(NAMES)


def test_every_part_of_the_engine_has_its_place_in_the_order() -> None:
    layers = CONTRACTS["importlinter:contract:parts-in-order"]["layers"].split()
    there = {f"gaussian_heritage.engine.{path.parent.name}" for path in (ROOT / "engine").glob("*/__init__.py")}
    assert there == {layer for layer in layers if layer.startswith("gaussian_heritage.engine.")}
    folders = {path.parent.name for path in (ROOT / "gaussian_heritage_addon").glob("*/__init__.py")}
    assert folders == set(CONTRACTS["importlinter:contract:add-on-in-order"]["layers"].split())


def test_only_parts_stand_in_the_engines_folder() -> None:
    assert {path.name for path in (ROOT / "engine").glob("*.py")} == {"__init__.py", "__main__.py"}


def test_package_without_init_is_not_overlooked() -> None:
    """A folder without ``__init__.py`` would be invisible to every contract."""
    folders = {path.parent for package in PACKAGES for path in (ROOT / package).rglob("*.py")}
    assert [str(folder.relative_to(ROOT)) for folder in sorted(folders) if not (folder / "__init__.py").exists()] == []


@pytest.fixture(scope="module")
def broken(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """What import-linter says of each contract that breaks in a copy of the code with every violation planted."""
    folder = tmp_path_factory.mktemp("planted")
    package = folder / "gaussian_heritage"
    package.mkdir()
    for name in (*PACKAGES, "__init__.py"):
        copy_code(ROOT / name, package / name)
    for number, (_, file, line) in enumerate(PLANTED):
        (package / file.replace("planted", f"planted_{number}")).write_text(f"{line}\n", encoding="utf-8")
    for file, line in CIRCLES.items():
        (package / file).write_text(f"{line}\n", encoding="utf-8")
    done = check_imports(folder)
    assert done.returncode != 0
    details = done.stdout.partition("Broken contracts\n")[2]
    sections = re.split(r"^(.+)\n-{10,}\n", details, flags=re.MULTILINE)
    return dict(zip(sections[1::2], sections[2::2], strict=True))


@pytest.mark.parametrize("number", range(len(PLANTED)), ids=[f"{file} {line}" for _, file, line in PLANTED])
def test_planted_violation_is_found(number: int, broken: dict[str, str]) -> None:
    contract, file, _ = PLANTED[number]
    assert f"{Path(file).parent.name}.planted_{number} ->" in broken[NAMES[contract]]


def test_planted_circles_of_modules_and_of_packages_are_found(broken: dict[str, str]) -> None:
    found = broken[NAMES["no-circles"]]
    assert "No cycles are allowed in gaussian_heritage.operators" in found and ".circle_a" in found
    assert "- .splats -> .project" in found
