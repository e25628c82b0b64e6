"""The summary says for each folder what was done, what was kept, and what went wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from engine.core.errors import SettingsError
from engine.pipeline.stages import STAGES
from engine.workers.batch import FolderState, summary_as_dict, summary_page, summary_text
from engine.workers.batch.folder_state import folder_states

FORECAST = {
    stage: {"stage": stage, "memory": memory, "memory_high": 2 * memory, "cpu_seconds": 10.0, "seconds": 10.0}
    for stage, memory in (("photos", 100), ("cameras", 900), ("training", 500), ("report", 200))
}


def folder(name: str = "a", **values: object) -> FolderState:
    made = FolderState(0, Path("/photos") / name, Path("/scenes") / name)
    for field, value in values.items():
        setattr(made, field, value)
    return made


def test_stages_follow_the_forecast_and_what_is_done_is_skipped() -> None:
    one = folder(forecast=FORECAST, done=["photos"])
    seen = []
    while not one.ended:
        seen.append(one.stage)
        one.done = [*one.done, one.stage]
        one.advance()
    assert seen == ["photos", "cameras", "training", "report"]


def test_finished_project_is_checked_by_one_task_that_reserves_for_all_stages() -> None:
    one = folder(forecast=FORECAST, done=["photos", "cameras", "training", "report"])
    one.advance()
    assert one.stage == STAGES[-1]
    # Were a setting changed, this task would do the cameras again.
    assert one.expected_memory(1) == (900, 1800)


def test_memory_is_that_of_the_stage() -> None:
    one = folder(forecast=FORECAST, done=["photos", "cameras"], computed=["photos", "cameras"], stage="training")
    assert one.expected_memory(1) == (500, 1000)
    assert folder().expected_memory(123) == (123, 123)


def test_stage_that_was_computed_twice_is_said() -> None:
    twice = folder(computed=["photos", "cameras", "cameras"], state="done")
    assert summary_as_dict([twice], [], 1.0)["twice"] == ["a"]
    assert "a: done twice: cameras." in summary_text([twice], [])


def test_page_escapes_names_and_links_reports() -> None:
    one = folder("<b> & c", done=["report"], state="done")
    page = summary_page([one], ["A note."], 100.0)
    assert "<b>" not in page
    assert 'href="%3Cb%3E%20%26%20c/report/report.html"' in page
    assert "1 of 1 folders are done." in page and "A note." in page


def test_two_folders_of_one_name_are_refused(tmp_path: Path) -> None:
    for name in ("x/Scan", "y/scan"):
        (tmp_path / name).mkdir(parents=True)
    with pytest.raises(SettingsError, match="have the same name"):
        folder_states([tmp_path / "x/Scan", tmp_path / "y/scan"], tmp_path / "out")
    with pytest.raises(SettingsError, match="does not exist"):
        folder_states([tmp_path / "missing"], tmp_path / "out")
