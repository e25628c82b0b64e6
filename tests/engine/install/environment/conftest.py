"""A package of our own in a folder of wheels, so that pip needs no index."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

NAMES = ("our_package", "our_torch")


def base_python() -> Path:
    """Return the Python that this environment was made from."""
    return Path(getattr(sys, "_base_executable", sys.executable))


@pytest.fixture(scope="session")
def empty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A new environment with pip. To make one takes seconds, so tests copy it."""
    folder = tmp_path_factory.mktemp("empty") / "environment"
    subprocess.run([base_python(), "-m", "venv", folder], check=True)
    return folder


@pytest.fixture
def wheels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with two wheels that is configured as pip's only source."""
    folder = tmp_path / "wheels"
    folder.mkdir()
    for name in NAMES:
        info = f"{name}-1.0.dist-info"
        with zipfile.ZipFile(folder / f"{name}-1.0-py3-none-any.whl", "w") as archive:
            archive.writestr(f"{name}.py", "HERE = True\n")
            archive.writestr(
                f"{info}/METADATA", f"Metadata-Version: 2.1\nName: {name.replace('_', '-')}\nVersion: 1.0\n"
            )
            archive.writestr(f"{info}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
            archive.writestr(f"{info}/RECORD", "")
    # As an address, since pip divides the variable at blanks.
    for name, value in {"FIND_LINKS": folder.as_uri(), "NO_INDEX": 1, "CONFIG_FILE": os.devnull}.items():
        monkeypatch.setenv(f"PIP_{name}", str(value))
    return folder


def locked(folder: Path, name: str, sha256: str | None = None) -> Path:
    """Write a locked file for one of the wheels in `folder`, with its hash or another one, and return it."""
    (wheel,) = folder.glob(f"{name}-*.whl")
    sha256 = sha256 or hashlib.sha256(wheel.read_bytes()).hexdigest()
    file = folder.parent / f"locked-{name}.txt"
    file.write_text(f"{name.replace('_', '-')}==1.0 \\\n    --hash=sha256:{sha256}\n")
    return file
