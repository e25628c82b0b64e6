"""What is imported is declared, what is declared is pinned, and ``pip install .`` gives the engine alone."""

from __future__ import annotations

import ast
import functools
import re
import subprocess
import sys
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from tests.conftest import ROOT

from .sources import nodes

REQUIREMENTS = ROOT / "requirements"
LOCKED_FILES = {
    file.stem: file
    for folder in (REQUIREMENTS, ROOT / "engine" / "install" / "environment")
    for file in folder.glob("locked-*.txt")
}
DISTRIBUTIONS = {
    "PIL": "pillow",
    "cv2": "opencv-contrib-python-headless",
    "cyclonedx": "cyclonedx-python-lib",
    "fast_simplification": "fast-simplification",
    "flip_evaluator": "flip-evaluator",
    "pillow_heif": "pillow-heif",
    "pxr": "usd-core",
    "sklearn": "scikit-learn",
}
# llvmlite is Numba's own compiler and comes with it.
NOT_ASKED_FOR = {"llvmlite"}
OPTIONAL = ("engine", "serve", "batch", "formats")
"""The engine's own requirements and its optional ones."""
LOCKED = {
    "engine-dev": ("engine", "serve", "batch", "formats", "dev", "torch"),
    "serve": ("engine", "serve"),
    "batch": ("engine", "serve", "batch"),
    "formats": ("engine", "formats"),
    "engine": ("engine", "torch"),
    **{file.stem: (file.stem, file.stem.replace("blender", "bpy")) for file in REQUIREMENTS.glob("blender-*.txt")},
    "installation": ("node", "pip"),
    "sbom": ("sbom",),
}


def pins(name: str) -> dict[str, str]:
    """The packages and versions of a file in requirements/, or a locked file."""
    file = LOCKED_FILES.get(name, REQUIREMENTS / f"{name}.txt")
    lines = file.read_text(encoding="utf-8").splitlines()
    pairs = [line.partition("==") for line in lines if line and not line.startswith(("#", "-r ", "    --hash="))]
    assert all(equals for _, equals, _ in pairs), f"{name}.txt holds a package without a version"
    return {normal(package): version.split()[0] for package, _, version in pairs}


def normal(package: str) -> str:
    """The name of a package as indexes compare it, without extras."""
    return re.sub(r"[-_.]+", "-", package.partition("[")[0]).lower()


@functools.cache
def imported(folder: Path) -> set[str]:
    """The distributions that the modules below a folder import from outside."""
    found = set()
    for path in folder.rglob("*.py"):
        for node in nodes(path.read_text(encoding="utf-8")):
            if isinstance(node, ast.Import):
                found |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                found.add(node.module.split(".")[0])
    found -= sys.stdlib_module_names
    return {DISTRIBUTIONS.get(name, name) for name in found}


def test_everything_the_engine_imports_is_declared() -> None:
    declared = {name for part in OPTIONAL for name in pins(part)}
    assert imported(ROOT / "engine") - NOT_ASKED_FOR - declared == set()


def test_everything_declared_is_imported() -> None:
    assert {name for part in OPTIONAL for name in pins(part)} <= imported(ROOT / "engine")


def test_the_extra_for_workers_is_what_batch_is_tested_with() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extra = dict(line.split("==") for line in project["optional-dependencies"]["batch"])
    assert extra == pins("batch")


def test_scripts_start_before_any_environment() -> None:
    ours = {path.stem for path in (ROOT / "scripts").glob("*.py")}
    # In Blender, or in the root of its window, which window.sh makes.
    in_blender = {"bpy", "mathutils", "numpy", "bl_ext", "addon_utils", "Xlib"}
    # In the environment of the engine, which `make setup` makes first: tests of Windows and the window, and releases.
    in_engine = {"cyclonedx-python-lib", "opencv-contrib-python-headless", "packaging", "pillow", "scipy"}
    ours |= {"container", "windows"}
    # `engine.install.environment` needs nothing else, as a contract of .importlinter demands.
    ours.add("engine")
    assert imported(ROOT / "scripts") - ours - in_blender - in_engine == set()


@pytest.mark.parametrize("name", LOCKED)
def test_pins_and_tested_set_agree(name: str) -> None:
    tested = {package: version for part in LOCKED[name] for package, version in pins(f"locked-{part}").items()}
    assert {package: tested.get(package) for package in pins(name)} == pins(name)


@pytest.mark.parametrize("file", sorted(LOCKED_FILES.values()), ids=lambda file: file.stem)
def test_every_locked_package_has_hashes_and_no_index(file: Path) -> None:
    text = re.sub(r"^#.*\n", "", file.read_text(encoding="utf-8"))
    packages = re.split(r"^(?=\S)", text, flags=re.MULTILINE)[1:]
    assert packages
    for package in packages:
        assert re.fullmatch(r"[\w.-]+(\[.*\])?==[\w.]+( ; [^\n]*)?( \\\n    --hash=sha256:[0-9a-f]{64})+\n", package), (
            package
        )


def test_locked_engine_is_complete() -> None:
    """It is installed without looking for dependencies, so each of them must be in it."""
    listed = {**pins("locked-engine"), **pins("locked-torch"), **pins("locked-cuda")}
    missing = set()
    for package in {**pins("locked-engine"), **pins("locked-torch")}:
        try:
            needs = metadata.requires(package) or []
        except metadata.PackageNotFoundError:
            continue  # of another platform
        required = [Requirement(line) for line in needs]
        missing |= {
            f"{package} needs {one}"
            for one in required
            if (one.marker is None or one.marker.evaluate({"extra": ""})) and normal(one.name) not in listed
        }
    assert missing == set()


def test_version_is_stated_in_one_place() -> None:
    """The build of the extension replaces that of the manifest, which Blender needs in the repository too."""
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert manifest["version"] == "0.0.0"
    assert "version" not in project["project"]
    assert project["tool"]["setuptools"]["dynamic"]["version"] == {"attr": "engine.__version__"}


def repository_files() -> list[str]:
    """The names of all files that git knows or would add."""
    listing = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    return subprocess.run(listing, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0")


def build_wheel(folder: Path) -> Path:
    """Build the wheel in `folder`, from a copy, since setuptools leaves its traces in the folder it builds."""
    copy = folder / "copy"
    for name in repository_files():
        if name.startswith(("demo/", "docs/")) or not (ROOT / name).is_file():
            continue
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        (copy / name).write_bytes((ROOT / name).read_bytes())
    options = ["--no-deps", "--no-build-isolation", "--no-index", "-w", str(folder), str(copy)]
    done = subprocess.run([sys.executable, "-m", "pip", "wheel", *options], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (wheel,) = folder.glob("*.whl")
    return wheel


def test_pip_install_gives_the_engine_alone(tmp_path: Path) -> None:
    names = repository_files()
    with zipfile.ZipFile(build_wheel(tmp_path)) as archive:
        inside = {name for name in archive.namelist() if ".dist-info/" not in name}
        metadata = next(archive.read(name).decode() for name in archive.namelist() if name.endswith("METADATA"))
    assert {name.split("/")[0] for name in inside} == {"engine"}
    # The page of the server is built in a checkout.
    left_out = ("__pycache__", "engine/serve/page/")
    there = {
        name
        for name in names
        if name.startswith("engine/") and not any(part in name for part in left_out) and (ROOT / name).is_file()
    }
    assert inside == there
    assert f"Requires-Dist: torch=={pins('engine')['torch']}" in metadata
