"""Search for a CPython of a given version in PATH, pyenv, the Windows launcher and uv. Standard library only."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...core.system import package_system, run_text

VERSIONS = ((3, 11), (3, 12), (3, 13))
"""Versions of Python that the engine's packages have files for, the one that is tested first."""

_PROBE = """
import importlib.util, platform, struct, sys
has = [importlib.util.find_spec(name) is not None for name in ("venv", "ensurepip")]
print(platform.python_implementation(), *sys.version_info[:2], 8 * struct.calcsize("P"), *has, platform.machine(),
      ascii(sys.executable), sep="|")
"""
_MAX_SECONDS = 30


@dataclass(frozen=True)
class Interpreter:
    """A 64-bit CPython that can create environments.

    Attributes
    ----------
    path : Path
    version : (int, int)
    has_pip : bool
        Whether it brings pip for new environments (Debian's needs the package python3-venv for that).
    """

    path: Path
    version: tuple[int, int]
    has_pip: bool


def find_python(version: tuple[int, int]) -> Path | None:
    """Return a 64-bit CPython of the version that can create environments with pip, None when there is none."""
    for candidate in _candidates(*version):
        found = _probe(candidate)
        if found and found.version == version and found.has_pip:
            return found.path
    return None


def find_pythons(preferred: Sequence[Path] = ()) -> Iterator[Interpreter]:
    """Yield each Python that the engine can be installed with: of `preferred`, then those found on this computer."""
    seen = set()
    for path in preferred:
        found = usable(path)
        if found and found.path not in seen:
            seen.add(found.path)
            yield found
    for version in VERSIONS:
        for candidate in _candidates(*version):
            found = _probe(candidate)
            if found and found.version == version and found.path not in seen:
                seen.add(found.path)
                yield found
                break


def usable(python: Path) -> Interpreter | None:
    """Return `python` as an interpreter, None when the engine cannot be installed with it."""
    found = _probe([str(python)])
    return found if found is not None and found.version in VERSIONS else None


def version_text(version: tuple[int, int]) -> str:
    """Return a version such as ``3.11``."""
    return ".".join(str(part) for part in version)


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
        answer = run_text([uv, "python", "find", f"{major}.{minor}"])
        if answer.returncode == 0:
            yield [answer.stdout.strip()]


def _probe(command: list[str]) -> Interpreter | None:
    """Return the Python that `command` starts; None when it does not, or is no 64-bit CPython with `venv`."""
    try:
        answer = run_text([*command, "-c", _PROBE], timeout=_MAX_SECONDS)
    except (OSError, subprocess.TimeoutExpired):
        return None
    words = answer.stdout.strip().split("|", 7)
    # Of the same processor as this Python: on Windows for ARM and on Apple chips, others run too, with other packages.
    own = [package_system().partition("-")[2]]
    if (
        answer.returncode
        or len(words) != 8
        or words[0] != "CPython"
        or words[3:5] != ["64", "True"]
        or [word.lower() for word in words[6:7]] != own
    ):
        return None
    # In ASCII, since another Python writes its path in the code page of the system.
    return Interpreter(Path(ast.literal_eval(words[7])), (int(words[1]), int(words[2])), words[5] == "True")
