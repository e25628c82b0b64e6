"""Scripts that write events, in place of the engine."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture
def script(tmp_path: Path) -> Callable[[str], list[str]]:
    """Return a function that turns Python source into a command. The source may print events with ``say(event)``."""

    def make(text: str) -> list[str]:
        file = tmp_path / "script.py"
        head = "import sys, time, signal\nfrom engine.core.events import *\n"
        # As the engine does: a process started with & in a shell ignores SIGINT by default.
        head += "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        head += "def say(event): print(to_json_line(event), flush=True)\n"
        file.write_text(head + text, encoding="utf-8")
        return [sys.executable, str(file)]

    return make
