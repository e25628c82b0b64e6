"""Several jobs: every result arrives, whatever becomes of the others, and none enters a file it does not belong to."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy
import pytest
from conftest import FOREVER, Draw, StandIn, forget_jobs, poll_to_the_end, segment_in_engine

pytestmark = pytest.mark.once

NAMED_BY_PROMPT = """
project, name = Path(sys.argv[4]), sys.argv[6]
write_object(project, name, name, np.r_[np.zeros(90), np.ones(10)].astype(np.float32))
say("finished", message="done", outputs={"objects": [name]})
"""


def _isolated() -> set[str]:
    return {obj.heritage.object_id for obj in bpy.data.objects if obj.heritage.role == "OBJECT"}


def test_every_prompt_for_the_same_project_gives_its_object(
    runner: ModuleType, project: Any, fake_engine: StandIn
) -> None:
    bpy.ops.heritage.open_project(directory=str(project.folder))
    fake_engine("import time\ntime.sleep(0.2)\n" + NAMED_BY_PROMPT)
    for prompt in ("bust", "drum", "shield"):
        segment_in_engine(runner, project, prompt)
    poll_to_the_end(runner)
    assert _isolated() == {"vase", "bust", "drum", "shield"} and runner.waiting() == []


def test_result_that_cannot_be_imported_does_not_keep_the_next_one_away(
    runner: ModuleType, project: Any, fake_engine: StandIn, part: Callable[[str], ModuleType]
) -> None:
    bpy.ops.heritage.open_project(directory=str(project.folder))
    damaged = "\nif name == 'bust': np.save(project / 'objects' / name / 'membership.npy', np.zeros(3, np.float32))\n"
    first, second = NAMED_BY_PROMPT.rsplit("say(", 1)
    fake_engine("import time\ntime.sleep(0.2)\n" + first + damaged + "say(" + second)
    segment_in_engine(runner, project, "bust")
    segment_in_engine(runner, project, "drum")
    runner._job.wait()
    assert runner._poll_timer() == runner._POLL_INTERVAL
    assert "another version of the scene" in part("gaussian_heritage_addon.blender.problems").shown()
    poll_to_the_end(runner)
    assert _isolated() == {"vase", "drum"}


def test_error_of_a_job_is_told_while_the_next_one_runs(
    runner: ModuleType, project: Any, fake_engine: StandIn, draw: Draw
) -> None:
    fake_engine(
        "import time\nif sys.argv[6] == 'bust':\n  time.sleep(0.2)\n  say('error', message='The disk is full.')\n"
        "  sys.exit(1)\n" + FOREVER
    )
    segment_in_engine(runner, project, "bust")
    segment_in_engine(runner, project, "drum")
    runner._job.wait()
    assert runner._poll_job() == runner._POLL_INTERVAL and runner.current()[1].running
    assert "The disk is full." in " ".join(draw("HERITAGE_PT_progress").texts)


def test_result_of_an_earlier_session_is_offered_and_not_put_into_a_new_file(
    runner: ModuleType, project: Any, fake_engine: StandIn, draw: Draw
) -> None:
    fake_engine("say('finished', message='done', outputs={'objects': ['vase']})")
    segment_in_engine(runner, project, "vase")
    runner._job.wait()
    forget_jobs(runner)
    bpy.ops.wm.read_homefile(use_empty=True)  # Blender was started again.
    runner._find_jobs()
    poll_to_the_end(runner)
    assert not bpy.context.scene.heritage.project and runner.undecided() == [project.folder]
    panel = draw("HERITAGE_PT_progress")
    assert "ended while you were away" in " ".join(panel.texts) and "another project" not in " ".join(panel.texts)
    assert bpy.ops.heritage.open_result(number=0) == {"FINISHED"}
    assert bpy.context.scene.heritage.project == str(project.folder) and len(bpy.data.scenes) == 1


def test_leaving_a_result_does_not_hide_that_of_a_newer_job(
    runner: ModuleType, project: Any, fake_engine: StandIn
) -> None:
    bpy.context.scene.heritage.project = "/somewhere/else"
    fake_engine(NAMED_BY_PROMPT)
    segment_in_engine(runner, project, "bust")
    poll_to_the_end(runner)
    assert runner.undecided() == [project.folder]
    bpy.context.scene.heritage.project = ""
    bpy.ops.heritage.open_project(directory=str(project.folder))
    segment_in_engine(runner, project, "drum")
    assert bpy.ops.heritage.dismiss_result(number=0) == {"FINISHED"}
    poll_to_the_end(runner)
    assert "drum" in _isolated()


def test_same_job_of_another_blender_is_not_started_twice(
    runner: ModuleType, project: Any, fake_engine: StandIn
) -> None:
    said = fake_engine(FOREVER)
    segment_in_engine(runner, project, "vase")
    job = runner._job
    # A process whose program is still being loaded has no command line to be recognised by.
    while not said.exists() and job.poll().running:
        time.sleep(0.02)
    forget_jobs(runner)
    with pytest.raises(Exception, match="still working on"):
        segment_in_engine(runner, project, "vase")
    runner._job = job


def test_project_that_is_opened_again_is_there_once(project: Any) -> None:
    for _ in range(2):
        bpy.ops.heritage.open_project(directory=str(project.folder))
        (whole,) = [obj for obj in bpy.data.objects if obj.heritage.role == "SCENE"]
        assert len([obj for obj in bpy.data.objects if obj.type == "CAMERA"]) == 1 and _isolated() == {"vase"}
        assert whole.location.x in (0.0, 3.0) and bpy.context.scene.camera is not None
        whole.location.x = 3.0
        bpy.context.view_layer.update()
    assert whole.matrix_world.translation.x == 3.0


def test_two_projects_are_in_two_scenes(project: Any, tmp_path: Path) -> None:
    first = bpy.context.scene
    bpy.ops.heritage.open_project(directory=str(project.folder))
    other = tmp_path / "other_heritage"
    shutil.copytree(project.folder, other)
    bpy.ops.heritage.open_project(directory=str(other))
    (second,) = [scene for scene in bpy.data.scenes if scene.heritage.project == str(other)]
    assert second != first and first.heritage.project == str(project.folder)
