"""Only engine/core/system asks which operating system it runs on."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import ROOT

from .sources import nodes

FOLDERS = ("engine", "gaussian_heritage_addon", "operators", "scripts")
PLACE = "engine/core/system"

FORBIDDEN = {
    "sys.platform", "os.name", "platform.system", "platform.machine", "platform.win32_ver", "platform.mac_ver",
    "os.kill", "os.killpg", "os.replace", "os.rename", "os.sched_getaffinity", "os.sched_setaffinity", "os.nice",
    "ctypes.windll", "ctypes.WinDLL", "subprocess.CREATE_NO_WINDOW", "subprocess.CREATE_NEW_PROCESS_GROUP",
}  # fmt: skip
MODULES = ("resource", "fcntl", "msvcrt", "winreg")
ASKED_BY_NAME = ("os", "signal", "subprocess")
"""Modules whose names differ between systems: ``hasattr(os, "nice")`` asks for the system too."""
NAMES_OF_TIMES = ("st_ctime", "st_ctime_ns")

EXCEPTIONS = {
    # Run inside of the real Blender window, in a container or on Linux alone.
    "scripts/window/", "scripts/container/", "scripts/container_test.py", "scripts/window_test.py", "scripts/windows/",
}  # fmt: skip


def questions(source: str) -> Iterator[str]:
    """Yield what in the source of a module depends on the operating system."""
    for node in nodes(source):
        if isinstance(node, ast.Attribute):
            name = f"{node.value.id}.{node.attr}" if isinstance(node.value, ast.Name) else node.attr
            if name in FORBIDDEN or node.attr in NAMES_OF_TIMES:
                yield name
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in MODULES)
        elif isinstance(node, ast.ImportFrom) and not node.level and node.module in MODULES:
            yield node.module
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("getattr", "hasattr"):
            yield from [ast.unparse(node)] if ast.unparse(node.args[0]) in ASKED_BY_NAME else []


def files() -> list[Path]:
    found = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")]
    names = {path: path.relative_to(ROOT).as_posix() for path in found}
    return [path for path, name in names.items() if not name.startswith((PLACE + "/", *EXCEPTIONS))]


def test_no_other_module_asks_for_the_system() -> None:
    found = {path: list(questions(path.read_text(encoding="utf-8"))) for path in files()}
    assert {str(path.relative_to(ROOT)): asked for path, asked in found.items() if asked} == {}


@pytest.mark.parametrize(
    "source",
    [
        "import sys\nif sys.platform == 'win32': pass", "import os\nos.name", "import fcntl", "from resource import x",
        "getattr(signal, 'SIGKILL', 0)", "hasattr(os, 'nice')", "os.replace(a, b)", "path.stat().st_ctime",
    ],
)  # fmt: skip
def test_questions_are_found(source: str) -> None:
    assert list(questions(source))
