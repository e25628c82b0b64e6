"""Public names of a package are there whichever thread asks for them first."""

from __future__ import annotations

import importlib
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from tests.conftest import wait_until

INIT = """
from typing import TYPE_CHECKING
from engine.core.lazy_exports import lazy_exports
if TYPE_CHECKING:
    from .slow import answer
__getattr__ = lazy_exports(__name__, __file__)
"""
SLOW = """
from slow_parts_gate import begun, may_end
begun.set()
may_end.wait()
answer = 42
"""


class Gate:
    """Stands in the place of a module, which holds an import until it may end."""

    def __init__(self) -> None:
        self.begun, self.may_end = threading.Event(), threading.Event()


@pytest.fixture
def gate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Gate]:
    """Write a package with a module whose import takes until the gate is opened."""
    folder = tmp_path / "slow_parts"
    folder.mkdir()
    (folder / "__init__.py").write_text(INIT)
    (folder / "slow.py").write_text(SLOW)
    monkeypatch.syspath_prepend(tmp_path)
    gate = Gate()
    monkeypatch.setitem(sys.modules, "slow_parts_gate", gate)
    yield gate
    gate.may_end.set()
    for name in ("slow_parts", "slow_parts.slow"):
        sys.modules.pop(name, None)


def test_name_of_a_module_that_another_thread_is_importing_is_waited_for(
    gate: Gate, monkeypatch: pytest.MonkeyPatch
) -> None:
    package, import_module = importlib.import_module("slow_parts"), importlib.import_module
    asking: list[str] = []
    found: list[object] = []

    def noted(name: str) -> ModuleType:
        asking.append(threading.current_thread().name)
        return import_module(name)

    monkeypatch.setattr(importlib, "import_module", noted)
    threads = [
        threading.Thread(target=lambda: found.append(getattr(package, "answer", "missing")), name=name)
        for name in ("first", "second")
    ]
    threads[0].start()
    gate.begun.wait()
    threads[1].start()
    wait_until(lambda: "second" in asking or not threads[1].is_alive())
    gate.may_end.set()
    for thread in threads:
        thread.join()
    assert found == [42, 42]
