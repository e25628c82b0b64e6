"""Jobs: queued, found again after Blender was closed, and never entering a scene that shows another project."""

from __future__ import annotations

import json
from contextlib import ExitStack
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy
import numpy as np
import pytest
from conftest import (
    FOREVER,
    Draw,
    Part,
    StandIn,
    forget_jobs,
    poll_to_the_end,
    segment_in_engine,
    write_object,
)

pytestmark = pytest.mark.once


@pytest.fixture
def vase_engine(fake_engine: StandIn) -> None:
    """An engine that says it has isolated the vase of the project."""
    fake_engine("say('finished', message='done', outputs={'objects': ['vase']})")


def test_second_job_waits_for_the_first_and_can_be_removed(
    runner: ModuleType, project: Any, draw: Draw, fake_engine: StandIn
) -> None:
    fake_engine(FOREVER)
    for prompt in ("vase", "bust", "drum"):
        segment_in_engine(runner, project, prompt)
    assert [one.command[-2] for one in runner.waiting()] == ["bust", "drum"]
    with pytest.raises(Exception, match="is waiting already"):
        segment_in_engine(runner, project, "bust")
    drawn = draw("HERITAGE_PT_progress")
    assert [options["number"] for name, options in drawn.buttons if name == "heritage.drop_job"] == [0, 1]
    assert bpy.ops.heritage.drop_job(number=0) == {"FINISHED"}
    assert [one.command[-2] for one in runner.waiting()] == ["drum"]
    runner._job.cancel(grace_seconds=0.0)
    runner._job.wait()
    first = runner._job
    assert runner._poll_job() == runner._POLL_INTERVAL
    assert runner._job is not first and runner.current()[1].running and runner.waiting() == []


def test_result_enters_the_scene_that_shows_its_project(runner: ModuleType, project: Any, vase_engine: None) -> None:
    bpy.ops.heritage.open_project(directory=str(project.folder))
    shown = bpy.context.scene
    other = bpy.data.scenes.new("other")
    other.heritage.project = "/somewhere/else"
    segment_in_engine(runner, project, "vase")
    poll_to_the_end(runner)
    assert shown.heritage.show == "OBJECTS" and runner.undecided() == []


def test_scene_with_another_project_is_never_changed_without_asking(
    runner: ModuleType, project: Any, vase_engine: None, draw: Draw
) -> None:
    bpy.context.scene.heritage.project = "/somewhere/else"
    segment_in_engine(runner, project, "vase")
    poll_to_the_end(runner)
    assert bpy.context.scene.heritage.project == "/somewhere/else" and "Vase" not in bpy.data.objects
    assert runner.undecided() == [project.folder]
    drawn = draw("HERITAGE_PT_progress")
    assert any(str(project.folder.name) in text for text in drawn.texts) or drawn.button("open_result")
    assert bpy.ops.heritage.open_result(number=0) == {"FINISHED"}
    (scene,) = [scene for scene in bpy.data.scenes if scene.heritage.project == str(project.folder)]
    assert "Vase" in scene.objects and runner.undecided() == []


def test_result_that_is_left_is_not_offered_again(runner: ModuleType, project: Any, vase_engine: None) -> None:
    bpy.context.scene.heritage.project = "/somewhere/else"
    segment_in_engine(runner, project, "vase")
    poll_to_the_end(runner)
    assert bpy.ops.heritage.dismiss_result(number=0) == {"FINISHED"}
    forget_jobs(runner)
    runner._find_jobs()
    assert runner.current() is None


def test_job_that_ended_while_blender_was_closed_is_told_and_taken_in_once(
    runner: ModuleType, project: Any, vase_engine: None, draw: Draw
) -> None:
    segment_in_engine(runner, project, "vase")
    runner._job.wait()
    forget_jobs(runner)  # Blender is closed and started again.
    bpy.ops.heritage.open_project(directory=str(project.folder))
    runner._find_jobs()
    assert "Started before Blender was closed" in draw("HERITAGE_PT_progress").texts
    poll_to_the_end(runner)
    assert bpy.context.scene.heritage.show == "OBJECTS"
    forget_jobs(runner)
    runner._find_jobs()
    assert runner.current() is None


def test_running_job_is_found_again(runner: ModuleType, project: Any, fake_engine: StandIn) -> None:
    fake_engine(FOREVER)
    segment_in_engine(runner, project, "vase")
    pid = runner._job._process.pid
    forget_jobs(runner)
    runner._find_jobs()
    assert runner._job._process.pid == pid and runner.current()[1].running


def test_jobs_that_waited_start_after_blender_was_closed(
    runner: ModuleType, project: Any, fake_engine: StandIn
) -> None:
    fake_engine(FOREVER)
    for prompt in ("vase", "bust", "drum"):
        segment_in_engine(runner, project, prompt)
    first = runner._job
    forget_jobs(runner)
    runner._find_jobs()
    assert runner._job._process.pid == first._process.pid
    assert [one.command[-2] for one in runner.waiting()] == ["bust", "drum"]
    runner._job.cancel(grace_seconds=0.0)
    runner._job.wait()
    first.wait()
    assert runner._poll_job() == runner._POLL_INTERVAL
    assert runner._job.command[-2] == "bust" and [one.command[-2] for one in runner.waiting()] == ["drum"]


def test_jobs_are_searched_again_after_a_file_was_loaded(
    runner: ModuleType, part: Part, monkeypatch: pytest.MonkeyPatch
) -> None:
    searched: list[bool] = []
    guards = part("gaussian_heritage_addon.blender.guards")
    monkeypatch.setattr(guards, "_REGISTERED", ExitStack())
    monkeypatch.setattr(runner._search_timer, "start", lambda *_, **__: searched.append(True))
    runner.register()
    try:
        bpy.ops.wm.read_homefile(use_empty=True)
        assert searched == [True, True]
    finally:
        guards._REGISTERED.close()
    bpy.ops.wm.read_homefile(use_empty=True)
    assert searched == [True, True]


def test_stopped_job_of_a_project_that_is_gone_says_so(
    runner: ModuleType, opened: Any, tmp_path: Path, fake_engine: StandIn
) -> None:
    fake_engine("say('error', message='The disk is full.')")
    segment_in_engine(runner, opened, "vase")
    poll_to_the_end(runner)
    opened.folder.rename(tmp_path / "away")
    with pytest.raises(RuntimeError, match=r"is missing, so its job cannot continue\. Choose .* Find Project"):
        bpy.ops.heritage.continue_job()


def test_stopped_job_continues_with_the_same_command(
    runner: ModuleType, project: Any, fake_engine: StandIn, draw: Draw
) -> None:
    arguments = fake_engine("say('error', message='The disk is full.')")
    segment_in_engine(runner, project, "vase")
    poll_to_the_end(runner)
    arguments.unlink()
    assert draw("HERITAGE_PT_scene").button("continue_job") == {"number": 0}
    assert bpy.ops.heritage.continue_job() == {"FINISHED"}
    runner._job.wait()
    assert '"vase"' in arguments.read_text(encoding="utf-8")


def test_refusal_is_told_once_and_gone_after_a_candidate_was_accepted(
    runner: ModuleType, project: Any, fake_engine: StandIn, draw: Draw
) -> None:
    bpy.ops.heritage.open_project(directory=str(project.folder))
    refused = {"refused": [{"text": "amphora", "message": "No amphora was found."}]}
    (project.folder / "objects" / "candidates.json").write_text(json.dumps(refused), encoding="utf-8")
    fake_engine("say('error', message='No amphora was found.', error='PromptError')")
    segment_in_engine(runner, project, "amphora")
    poll_to_the_end(runner)
    assert not bpy.types.HERITAGE_PT_progress.poll(bpy.context)
    told = [draw(name).texts for name in ("HERITAGE_PT_scene", "HERITAGE_PT_objects")]
    assert sum("No amphora was found." in " ".join(texts) for texts in told) == 1
    fake_engine("say('finished', message='done', outputs={'objects': ['vase']})")
    bpy.ops.heritage.accept_candidate(number=1)
    poll_to_the_end(runner)
    assert not (project.folder / "objects" / "candidates.json").exists()


def test_adjusting_the_last_operation_starts_no_job(part: Part) -> None:
    starts_jobs = part("operators.segmenting").SegmentOperator
    operators = [cls for cls in part("operators").CLASSES if issubclass(cls, starts_jobs)]
    operators += list(part("operators.import_photos").CLASSES)
    assert len(operators) > 5
    for operator in operators:
        assert "UNDO" not in getattr(operator, "bl_options", set()), operator


def test_only_sidebars_and_preferences_are_drawn_again(part: Part, monkeypatch: pytest.MonkeyPatch) -> None:
    """The whole scene takes a minute in software."""
    drawn: list[str] = []

    class Region:
        def __init__(self, kind: str) -> None:
            self.type, self.tag_redraw = kind, lambda: drawn.append(kind)

    class Area:
        def __init__(self, kind: str) -> None:
            self.type, self.tag_redraw = kind, lambda: drawn.append(kind)
            self.regions = [Region("WINDOW"), Region("UI"), Region("HEADER")]

    class Bpy:
        class context:  # noqa: N801 as in bpy
            class window_manager:  # noqa: N801
                class screen:  # noqa: N801
                    areas = [Area("VIEW_3D"), Area("OUTLINER"), Area("PREFERENCES")]

                windows: list[Any] = []

    window = type("Window", (), {"screen": Bpy.context.window_manager.screen})
    Bpy.context.window_manager.windows = [window]
    monkeypatch.setattr(part("gaussian_heritage_addon.blender.guards"), "bpy", Bpy)
    part("gaussian_heritage_addon.blender.guards").redraw()
    assert drawn == ["UI", "PREFERENCES"]


def test_default_cube_and_light_are_removed_only_while_untouched(project: Any, part: Part, draw: Draw) -> None:
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    scene = bpy.context.scene
    untouched = part("gaussian_heritage_addon.blender.default_objects").untouched_defaults
    assert sorted(obj.name for obj in untouched(scene)) == ["Cube", "Light"]
    scene.objects["Cube"].location.x = 1.0
    bpy.context.view_layer.update()
    assert [obj.name for obj in untouched(scene)] == ["Light"]


def test_photo_is_seen_where_its_camera_is_looked_through(project: Any) -> None:
    bpy.ops.heritage.open_project(directory=str(project.folder))
    bpy.ops.heritage.look_through_photo()
    cameras = [obj for obj in bpy.data.objects if obj.type == "CAMERA"]
    assert [obj.visible_get() for obj in cameras] == [obj == bpy.context.scene.camera for obj in cameras]


def test_background_is_listed_last(project: Any, part: Part) -> None:
    write_object(project.folder, "all the rest", "A background", np.ones(100, np.float32))
    bpy.ops.heritage.open_project(directory=str(project.folder))
    bpy.data.objects["A background"].heritage.kind = "background"
    rows = part("gaussian_heritage_addon.panels.objects_panel").HERITAGE_UL_objects
    instance = type("Rows", (), {"bitflag_filter_item": 1})()
    shown, places = rows.filter_items(instance, bpy.context, bpy.data, "objects")
    names = [obj.name for obj in bpy.data.objects]
    order = sorted((places[i], names[i]) for i in range(len(names)) if shown[i])
    assert [name for _, name in order] == ["Vase", "A background"]
