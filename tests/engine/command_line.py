"""Calls the command line as a person or Blender would, in this process or in one of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from typing import Any

import pytest

from engine.cli.main import main
from tests.conftest import PATIENCE, ROOT


@dataclass(frozen=True)
class Answer:
    """What a command said: its exit code and its events, oldest first."""

    code: int
    events: list[dict[str, Any]]

    def of_kind(self, kind: str) -> list[dict[str, Any]]:
        """The events of one kind."""
        return [event for event in self.events if event["kind"] == kind]

    @property
    def error(self) -> str:
        """The one sentence of a command that failed; no traceback, and no success beside it."""
        (error,) = self.of_kind("error")
        assert self.code != 0
        assert not self.of_kind("finished")
        message: str = error["message"]
        assert "Traceback" not in message and "unexpected error" not in message and "\n" not in message, message
        return message

    @property
    def computed(self) -> list[str]:
        """The stages that were not reused."""
        return [event["stage"] for event in self.of_kind("stage_finished") if not event["reused"]]


def call(capsys: pytest.CaptureFixture[str], *arguments: object) -> Answer:
    """Run one command in this process."""
    capsys.readouterr()
    code = main([*(str(argument) for argument in arguments), "--events"])
    return Answer(code, events_of(capsys.readouterr().out))


def events_of(output: str) -> list[dict[str, Any]]:
    """Return the events of a command's standard output; every line is one."""
    return [json.loads(line) for line in output.splitlines()]


def start(*arguments: object, before: str = "") -> subprocess.Popen[str]:
    """Start one command in a process of its own, after the Python code `before`."""
    run = f"import sys\n{before}\nfrom engine.__main__ import start\nsys.exit(start())"
    return subprocess.Popen(
        [sys.executable, "-c", run, *(str(argument) for argument in arguments), "--events"],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
    )


def call_alone(*arguments: object, before: str = "") -> Answer:
    """Run one command in a process of its own to its end."""
    process = start(*arguments, before=before)
    out, err = process.communicate(timeout=PATIENCE)
    assert "Traceback" not in err, err
    return Answer(process.returncode, events_of(out))
