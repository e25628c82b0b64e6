"""Short work for a request ends with the engine's own sentence, or is killed when it takes too long."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from engine.core.errors import HeritageError, ProjectError
from engine.serve import engine_call
from engine.serve.engine_call import call_engine
from engine.workers.jobs import EngineRun


def test_engine_that_refuses_says_why(tmp_path: Path) -> None:
    with pytest.raises(HeritageError, match="is not a Gaussian Heritage project"):
        call_engine(["report", str(tmp_path)], "report")


def test_call_that_takes_too_long_leaves_no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    runs: list[EngineRun] = []

    def begin(*given: Any) -> EngineRun:
        runs.append(EngineRun(*given))
        return runs[-1]

    monkeypatch.setattr(engine_call, "EngineRun", begin)
    monkeypatch.setattr(engine_call, "_MAX_SECONDS", 0)
    with pytest.raises(ProjectError, match="The check took more than 0 seconds"):
        call_engine(["doctor"], "check")
    assert not runs[0].process.poll()
