"""Words asked of the scene so far, beside the job that trains it: the answer in the panel, and what the job does."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy
import pytest
from conftest import FOREVER, Draw, FakeLayout, Part, StandIn, forget_jobs

pytestmark = pytest.mark.once

ADDON = "gaussian_heritage_addon"
TRAINS = f"""
if 'ask' not in sys.argv:
    say('stage_started', stage='training')
    say('progress', stage='training', fraction=0.5, seconds_left=60.0, message='step 500')
    {FOREVER.replace(chr(10), chr(10) + "    ")}
out = Path(next(one for one in sys.argv if one.startswith('--out=')).partition('=')[2])
"""
"""Source of a fake engine that trains a scene without end, and answers questions by what is written behind it."""
ANSWERS = (
    TRAINS
    + """
out.mkdir(parents=True)
import struct, zlib
def chunk(kind, data): return struct.pack('>I', len(data)) + kind + data + struct.pack('>I', zlib.crc32(kind + data))
head = chunk(b'IHDR', struct.pack('>IIBBBBB', 4, 3, 8, 2, 0, 0, 0))
rows = chunk(b'IDAT', zlib.compress(3 * (b'\\0' + bytes(12)))) + chunk(b'IEND', b'')
(out / '1.png').write_bytes(b'\\x89PNG\\r\\n\\x1a\\n' + head + rows)
found = [{'text': 'vase', 'photo': 'view_1.jpg', 'picture': str(out / '1.png')}]
say('finished', message='', outputs={'step': 500, 'found': found, 'refused': {'ghost': 'Nothing looks like a ghost.'}})
"""
)
TOLD = "The scene after step 500 of its training. Nothing is stored."


@pytest.fixture
def questions(part: Part, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[ModuleType]:
    module = part(f"{ADDON}.jobs.scene_question")
    monkeypatch.setattr(module, "user_folder", lambda name: _made(tmp_path / name))
    yield module
    if module._question is not None:
        module._question.job.cancel(grace_seconds=0.0)
        module._question.job.wait()
    module.stop()


def _made(folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture
def training(runner: ModuleType, project: Any, fake_engine: StandIn) -> Callable[[str], ModuleType]:
    """Return a function that starts a job with a fake engine, and returns the runner when the job trains."""

    def start(engine: str) -> ModuleType:
        fake_engine(engine)
        runner.start("reconstruct", project.folder, "reconstruct")
        while runner.current()[1].stage != "training":
            time.sleep(0.02)
        return runner

    return start


def end_job(runner: ModuleType) -> None:
    """Cancel the job, and let the timer see its end."""
    runner._job.cancel(grace_seconds=0.0)
    runner._job.wait()
    runner._poll_job()


def wait_for(questions: ModuleType) -> None:
    """Poll until the engine has answered."""
    while questions.poll() is not None:
        time.sleep(0.02)


def is_answering(drawn: FakeLayout) -> bool:
    return any(name == "heritage.cancel_question" for name, _ in drawn.buttons)


def test_answer_stands_in_the_panel_of_the_job_with_what_it_is_made_of(
    training: Callable[[str], ModuleType], questions: ModuleType, project: Any, draw: Draw, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, part: Part,
) -> None:  # fmt: skip
    shown: list[Path] = []
    monkeypatch.setattr(part(f"{ADDON}.panels.question_box"), "picture_icon", lambda file: shown.append(file) or 7)
    before = sorted((file, file.stat().st_mtime_ns) for file in project.folder.rglob("*"))
    runner = training(ANSWERS)
    job = runner._job
    bpy.context.scene.heritage.question = "vase, ghost"
    drawn = draw("HERITAGE_PT_progress")
    assert "question" in drawn.props and drawn.button("ask_scene") == {"words": "vase, ghost"}
    assert bpy.ops.heritage.ask_scene(words="vase, ghost") == {"FINISHED"}
    assert "Looking for vase, ghost ..." in draw("HERITAGE_PT_progress").texts
    command = json.loads((tmp_path / "question" / "job.json").read_text(encoding="utf-8"))["command"]
    assert command[3:6] == ["ask", str(project.folder), "--prompt=vase, ghost"]
    wait_for(questions)
    drawn = draw("HERITAGE_PT_progress")
    assert {"vase, ghost", "vase in view_1.jpg", "Nothing looks like a ghost.", TOLD} <= set(drawn.texts)
    assert shown[-1].name == "1.png" and shown[-1].is_file() and "template_icon" in drawn.calls
    # The job goes on, and its project is as it was.
    assert runner._job is job and runner.current()[1].running and runner.waiting() == []
    assert sorted((file, file.stat().st_mtime_ns) for file in project.folder.rglob("*")) == before
    assert bpy.ops.heritage.dismiss_answer() == {"FINISHED"}
    assert TOLD not in draw("HERITAGE_PT_progress").texts


def test_next_question_deletes_the_pictures_of_the_last(
    training: Callable[[str], ModuleType], questions: ModuleType, tmp_path: Path
) -> None:
    training(ANSWERS)
    for _ in range(2):
        questions.ask("vase")
        wait_for(questions)
    assert len(list((tmp_path / "question").glob("pictures *"))) == 1


def test_scene_is_asked_only_while_it_is_trained(
    runner: ModuleType, project: Any, questions: ModuleType, fake_engine: StandIn, draw: Draw
) -> None:
    for kind, stage in (("reconstruct", "cameras"), ("segment", "training")):
        fake_engine(f"say('stage_started', stage={stage!r})\n{FOREVER}")
        runner.start(kind, project.folder, kind)
        while not runner.current()[1].stage:
            time.sleep(0.02)
        assert "question" not in draw("HERITAGE_PT_progress").props
        with pytest.raises(RuntimeError, match="No scene is being trained"):
            bpy.ops.heritage.ask_scene(words="vase")
        end_job(runner)
        forget_jobs(runner)


def test_words_that_cannot_be_asked_are_refused_before_an_engine_starts(
    training: Callable[[str], ModuleType], questions: ModuleType
) -> None:
    training(ANSWERS)
    for words, sentence in ((" , ", "names nothing"), ("a, b, c, d, e, f", "at most 5 texts")):
        with pytest.raises(RuntimeError, match=sentence):
            bpy.ops.heritage.ask_scene(words=words)
    assert questions.shown() is None


def test_refusal_and_answers_of_another_form_are_sentences_in_the_panel(
    training: Callable[[str], ModuleType], questions: ModuleType, fake_engine: StandIn, draw: Draw
) -> None:
    refusal = "The scene has no shape yet that could be asked. Ask again in a minute."
    training(TRAINS)
    for engine, sentence in (
        (f"say('error', message={refusal!r}, error='ProjectError'); sys.exit(3)", refusal),
        ("say('finished', message='', outputs={'step': 'many'})", "The engine's answer cannot be read"),
        ("say('finished', message='', outputs={'step': 1, 'refused': {}, 'found': [{'text': 'a', 'photo': 'b', "
         "'picture': '..'}]})", "out of the folder"),
        ("sys.exit('a crash')", "The engine stopped unexpectedly"),
    ):  # fmt: skip
        fake_engine(engine)
        questions.ask("vase")
        wait_for(questions)
        assert sentence in " ".join(draw("HERITAGE_PT_progress").texts)


def test_question_is_cancelled_and_the_job_goes_on(
    training: Callable[[str], ModuleType], questions: ModuleType, draw: Draw, fake_engine: StandIn
) -> None:
    runner = training(TRAINS)
    fake_engine(
        f"from time import sleep\nfolder = Path({str(questions.user_folder('question'))!r})\n"
        "while not (folder / 'stop').exists(): sleep(0.02)\n"
        "say('error', message='Stopped while isolating; no object was stored.', error='Cancelled'); sys.exit(4)"
    )
    bpy.ops.heritage.ask_scene(words="vase")
    with pytest.raises(RuntimeError, match="A question is still being answered"):
        bpy.ops.heritage.ask_scene(words="cup")
    assert is_answering(draw("HERITAGE_PT_progress"))
    assert bpy.ops.heritage.cancel_question() == {"FINISHED"}
    wait_for(questions)
    assert questions.shown() is None and runner.current()[1].running
    with pytest.raises(RuntimeError, match="No question is being answered"):
        bpy.ops.heritage.cancel_question()


def test_answer_comes_after_the_job_was_stopped(
    training: Callable[[str], ModuleType], questions: ModuleType, tmp_path: Path, draw: Draw
) -> None:
    go_on = tmp_path / "go on"
    waits = f"import time\nwhile not Path({str(go_on)!r}).exists(): time.sleep(0.02)\n"
    runner = training(ANSWERS.replace("out.mkdir", waits + "out.mkdir"))
    questions.ask("vase")
    end_job(runner)
    drawn = draw("HERITAGE_PT_progress")
    assert is_answering(drawn) and "question" not in drawn.props
    go_on.touch()
    wait_for(questions)
    assert TOLD in draw("HERITAGE_PT_progress").texts


def test_undo_saving_and_another_file_leave_the_question_alone(
    training: Callable[[str], ModuleType], questions: ModuleType, tmp_path: Path, draw: Draw
) -> None:
    go_on = tmp_path / "go on"
    waits = f"import time\nwhile not Path({str(go_on)!r}).exists(): time.sleep(0.02)\n"
    training(ANSWERS.replace("out.mkdir", waits + "out.mkdir"))
    bpy.ops.ed.undo_push(message="before")
    bpy.context.scene.heritage.question = "vase"
    questions.ask(bpy.context.scene.heritage.question)
    bpy.ops.ed.undo_push(message="after")
    bpy.ops.ed.undo()
    assert is_answering(draw("HERITAGE_PT_progress"))
    bpy.context.scene.heritage.question = "vase"
    file = str(tmp_path / "asked.blend")
    bpy.ops.wm.save_as_mainfile(filepath=file)
    bpy.ops.wm.open_mainfile(filepath=file)
    assert bpy.context.scene.heritage.question == "vase" and is_answering(draw("HERITAGE_PT_progress"))
    # The timer outlives the loading of a file.
    assert bpy.app.timers.is_registered(questions._timer._call)
    go_on.touch()
    wait_for(questions)
    # Every window shows the same, whatever scene it has.
    bpy.context.window_manager.windows[0].scene = bpy.data.scenes.new("of another window")
    assert TOLD in draw("HERITAGE_PT_progress").texts


def test_question_that_a_crashed_blender_left_is_shown_and_can_be_cancelled(
    training: Callable[[str], ModuleType], questions: ModuleType, fake_engine: StandIn, draw: Draw
) -> None:
    training(TRAINS)
    fake_engine(FOREVER)
    questions.ask("vase")
    questions._question = None
    with pytest.raises(RuntimeError, match="A question is still being answered"):
        bpy.ops.heritage.ask_scene(words="cup")
    assert "Looking for vase ..." in draw("HERITAGE_PT_progress").texts


def test_question_ends_with_blender(
    training: Callable[[str], ModuleType], questions: ModuleType, fake_engine: StandIn
) -> None:
    runner = training(TRAINS)
    fake_engine(FOREVER)
    questions.ask("vase")
    job = questions.shown().job
    questions.stop()
    assert (job.folder / "stop").exists() and not (runner._job.folder / "stop").exists()
    job.cancel(grace_seconds=0.0)
    job.wait()
