"""Stopped jobs keep their Continue, belong to their file, and move no button."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import Any

import bpy
import pytest
from conftest import FOREVER, Draw, FakeLayout, Part, StandIn, forget_jobs, poll_to_the_end, segment_in_engine

pytestmark = pytest.mark.once

FAILS_FOR_BUST = """
if any("bust" in word for word in sys.argv):
    say('error', message='The disk is full.', error='DiskError')
    sys.exit(1)
say('finished', message='done', outputs={'objects': ['vase']})
"""


def _names(runner: ModuleType) -> list[str]:
    return [job.command[-2] for _, job, _ in runner.stopped(bpy.context.scene)]


def test_stopped_job_keeps_its_continue_whatever_runs_after_it(
    runner: ModuleType, opened: Any, fake_engine: StandIn, draw: Draw
) -> None:
    fake_engine(FAILS_FOR_BUST)
    segment_in_engine(runner, opened, "bust")
    poll_to_the_end(runner)
    segment_in_engine(runner, opened, "vase")
    poll_to_the_end(runner)
    assert _names(runner) == ["bust"]
    assert draw("HERITAGE_PT_scene").button("continue_job") == {"number": 0}
    drawn = draw("HERITAGE_PT_progress")
    assert "The disk is full." in " ".join(drawn.texts) and drawn.button("continue_job") == {"number": 0}
    # Also after Blender was closed.
    forget_jobs(runner)
    runner._find_jobs()
    poll_to_the_end(runner)
    assert _names(runner) == ["bust"]
    fake_engine("say('finished', message='done', outputs={'objects': ['vase']})")
    assert bpy.ops.heritage.continue_job(number=0) == {"FINISHED"}
    poll_to_the_end(runner)
    assert _names(runner) == []
    forget_jobs(runner)
    runner._find_jobs()
    assert runner.current() is None


def test_missing_model_file_is_told_with_the_buttons_of_blender(
    runner: ModuleType, opened: Any, fake_engine: StandIn, draw: Draw
) -> None:
    fake_engine("say('error', message='minilm.onnx is missing. Run: python', error='ModelFileError')\nsys.exit(1)")
    segment_in_engine(runner, opened, "bust")
    poll_to_the_end(runner)
    assert "Repair Engine, or Fetch beside the model, in Preferences" in " ".join(draw("HERITAGE_PT_progress").texts)


def test_name_of_a_stopped_job_is_whole_in_a_narrow_sidebar(
    runner: ModuleType, part: Part, opened: Any, fake_engine: StandIn, draw: Draw, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(part("gaussian_heritage_addon.blender.drawn_text"), "_DEFAULT_LINE_LENGTH", 25)
    fake_engine(FAILS_FOR_BUST)
    runner.start("segment", opened.folder, "segment", str(opened.folder), "--prompt=bust with a laurel wreath")
    poll_to_the_end(runner)
    # Beside its button, the first row has room for one word.
    assert "Stopped" in draw("HERITAGE_PT_scene").texts
    told = draw("HERITAGE_PT_progress").texts
    assert "Stopped: isolate bust with a laurel wreath" in " ".join(told) and max(map(len, told)) <= 25


def test_each_of_several_stopped_jobs_is_continued_or_left(
    runner: ModuleType, opened: Any, fake_engine: StandIn
) -> None:
    fake_engine("say('error', message='The disk is full.', error='DiskError')")
    for prompt in ("bust", "drum", "mask"):
        segment_in_engine(runner, opened, prompt)
        poll_to_the_end(runner)
    assert _names(runner) == ["mask", "drum", "bust"]
    assert bpy.ops.heritage.leave_job(number=1) == {"FINISHED"}
    assert _names(runner) == ["mask", "bust"]
    fake_engine(FOREVER)
    assert bpy.ops.heritage.continue_job(number=0) == {"FINISHED"}
    assert runner.current()[0].command[-2] == "bust" and _names(runner) == ["mask"]
    # Another one waits for it, and nothing is lost.
    assert bpy.ops.heritage.continue_job(number=0) == {"FINISHED"}
    assert [one.command[-2] for one in runner.waiting()] == ["mask"] and _names(runner) == []


def test_edits_stored_anew_leave_no_older_ones_to_continue(
    runner: ModuleType, opened: Any, fake_engine: StandIn
) -> None:
    fake_engine("say('error', message='Nothing would be left of the vase.', error='ObjectError')\nsys.exit(1)")
    folder = str(opened.folder)
    segment_in_engine(runner, opened, "bust")
    poll_to_the_end(runner)
    for threshold in ("1", "0.9"):
        runner.start("segment", opened.folder, "edit", folder, "--threshold", f"vase={threshold}")
        poll_to_the_end(runner)
        stopped = [job.command[3:5] for _, job, _ in runner.stopped(bpy.context.scene)]
        # What else has stopped stays.
        assert stopped == [["edit", folder], ["segment", folder]]
    fake_engine("say('finished', message='Stored vase.', outputs={'objects': ['vase']})")
    runner.start("segment", opened.folder, "edit", folder, "--threshold", "vase=0.5")
    poll_to_the_end(runner)
    assert _names(runner) == ["bust"]


def test_refusal_is_no_stopped_job(runner: ModuleType, opened: Any, fake_engine: StandIn) -> None:
    fake_engine("say('error', message='No amphora was found.', error='PromptError')")
    segment_in_engine(runner, opened, "amphora")
    poll_to_the_end(runner)
    assert _names(runner) == []


def test_error_of_another_file_is_not_shown(runner: ModuleType, opened: Any, fake_engine: StandIn, draw: Draw) -> None:
    fake_engine("say('error', message='The disk is full.', error='DiskError')")
    segment_in_engine(runner, opened, "bust")
    poll_to_the_end(runner)
    runner.problems.show("Something of this file.")
    bpy.ops.wm.read_homefile(use_empty=True)
    runner._after_loading()
    assert _names(runner) == [] and not bpy.types.HERITAGE_PT_progress.poll(bpy.context)
    assert "Ready" in draw("HERITAGE_PT_scene").texts
    bpy.context.scene.heritage.project = "/somewhere/else"
    assert _names(runner) == []
    bpy.context.scene.heritage.project = str(opened.folder)
    assert _names(runner) == ["bust"]


def test_first_row_says_what_waits_and_nothing_above_the_buttons_moves(
    runner: ModuleType, opened: Any, fake_engine: StandIn, draw: Draw
) -> None:
    fake_engine(FOREVER)
    idle = _rows_above_the_buttons(draw)
    segment_in_engine(runner, opened, "bust")
    runner.start("segment", opened.folder, "segment", str(opened.folder), "--prompt=vase")
    assert any(text.endswith("+1 waiting: isolate vase") for text in draw("HERITAGE_PT_scene").texts)
    assert _rows_above_the_buttons(draw) == idle
    runner.start("segment", opened.folder, "segment", str(opened.folder), "--all")
    assert any(text.endswith("+2 waiting: isolate vase, find all") for text in draw("HERITAGE_PT_scene").texts)
    for number in (1, 0):
        runner.drop(number)
    runner._job.cancel(grace_seconds=0.0)
    poll_to_the_end(runner)
    assert _names(runner) == ["bust"]
    assert _rows_above_the_buttons(draw) == idle
    runner.problems.show("An import failed.")
    assert _rows_above_the_buttons(draw) == idle


def _rows_above_the_buttons(draw: Draw) -> int:
    """Return how many rows the panel has above *Import Photo Folder*."""
    count = 0

    class Counting(FakeLayout):
        def row(self, **_: Any) -> Any:
            nonlocal count
            if not any(name == "heritage.import_photo_folder" for name, _ in self.buttons):
                count += 1
            return self

    layout = Counting()
    bpy.types.HERITAGE_PT_scene.draw(type("Panel", (), {"layout": layout})(), bpy.context)
    before = [name for name, _ in layout.buttons]
    assert "heritage.import_photo_folder" in before
    return count


def test_jobs_have_the_names_of_their_buttons(part: Part) -> None:
    name = part("gaussian_heritage_addon.jobs.job_names").job_name
    project, engine = Path("/rooms/room_heritage"), ["python", "-m", "engine", "segment", "/rooms/room_heritage"]
    for words, expected in (
        (["--prompt=vase,teapot"], "isolate vase, teapot"),
        (["--prompt=vase", "--name=amphora"], "isolate vase"),
        (["--click=a.jpg=1,2", "--name=amphora"], "isolate amphora"),
        (["--click=a.jpg=1,2"], "isolate what was clicked"),
        (["--refine=vase", "--click=a.jpg=1,2"], "correct vase"),
        (["--all"], "find all"),
        (["--complement"], "isolate the background"),
        (["--accept=1"], "isolate a candidate"),
        (["--detail=vase"], "add detail to vase"),
        (["--detail"], "add detail to all objects"),
    ):
        assert name("segment", project, [*engine, *words]) == expected
    assert name("segment", project, ["python", "-m", "engine", "edit", str(project)]) == "store edits"
    assert name("reconstruct", project, engine) == "reconstruct room_heritage"
