"""Search for a CPython of a given version in PATH, pyenv, the Windows launcher and uv. Standard library only."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

__all__ = ["find_python"]

_PROBE = """
import sys, platform, struct, venv, ensurepip
print(platform.python_implementation(), *sys.version_info[:2], 8 * struct.calcsize("P"), sys.executable, sep="|")
"""


def find_python(version: tuple[int, int]) -> Path | None:
    """Return a 64-bit CPython of the version that can create environments, None when there is none."""
    for candidate in _candidates(*version):
        found = _probe(candidate)
        if found and found[:4] == ["CPython", str(version[0]), str(version[1]), "64"]:
            return Path(found[4])
    return None


def _candidates(major: int, minor: int) -> Iterator[list[str]]:
    """Yield commands that may start the version, the most likely first."""
    yield [sys.executable]
    name = f"python{major}.{minor}"
    for folder in os.environ.get("PATH", "").split(os.pathsep):
        for program in (name, "python3", "python"):
            found = shutil.which(program, path=folder) if folder else None
            if found:
                yield [found]
    pyenv = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv")
    for versions in (pyenv / "versions", pyenv / "pyenv-win" / "versions"):
        for installed in sorted(versions.glob(f"{major}.{minor}.*")):
            for python in (installed / "bin" / name, installed / "python.exe"):
                if python.exists():
                    yield [str(python)]
    if shutil.which("py"):
        yield ["py", f"-{major}.{minor}"]
    uv = shutil.which("uv")
    if uv:
        answer = subprocess.run([uv, "python", "find", f"{major}.{minor}"], capture_output=True, text=True, check=False)
        if answer.returncode == 0:
            yield [answer.stdout.strip()]


def _probe(command: list[str]) -> list[str] | None:
    """Return implementation, major, minor, bits and path of a Python; None when it does not start or has no venv."""
    try:
        answer = subprocess.run(
            [*command, "-c", _PROBE], capture_output=True, text=True, check=False, timeout=30, stdin=subprocess.DEVNULL
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return answer.stdout.strip().split("|") if answer.returncode == 0 else None
