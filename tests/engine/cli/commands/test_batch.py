"""`batch` passes on what is asked for to the engine of each folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from engine.core.errors import Cancelled
from engine.core.events import ignore_events
from tests.engine.command_line import call

pytest.importorskip("distributed")


def test_device_that_is_asked_for_is_passed_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import engine.workers.batch

    asked: list[tuple[str, ...]] = []

    def refuse(folders: Any, settings: Any, *, emit: Any = ignore_events, should_stop: Any) -> None:
        asked.append(settings.arguments)
        raise Cancelled("Stopped.")

    monkeypatch.setattr(engine.workers.batch, "run_batch", refuse)
    for more in ([], ["--device", "cpu"]):
        assert call(capsys, "batch", tmp_path, "--out", tmp_path / "out", *more).error == "Stopped."
    assert asked == [("--preset=standard",), ("--preset=standard", "--device=cpu")]
