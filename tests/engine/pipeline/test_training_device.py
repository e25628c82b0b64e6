"""`reconstruct` trains on a card without being told, says so, and is done or continues where there is none."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

import engine.training
from engine.core.errors import Cancelled, EnvironmentProblem
from engine.training.card_settings import CARD_SIZES, CardSizes
from tests.engine.command_line import Answer, call
from tests.engine.museum import VIEWS, write_cameras, write_photos

REASON = "this computer has no graphics card"
CARD = {"backend": "gpu", "name": "Card (Vulkan)", "max_buffer_bytes": 2 << 30, "memory": 8 << 30}


@dataclass
class Computer:
    """A computer with or without a card, on which a photo folder is reconstructed."""

    command: list[object]
    scene: Path
    capsys: pytest.CaptureFixture[str]
    card: dict[str, Any] | None = None
    looked: int = 0
    backends: list[str] = field(default_factory=list)
    train: Callable[..., Any] = engine.training.train

    def find(self, *_: object, **__: object) -> dict[str, Any]:
        """Answer in place of the child process that tests the card."""
        self.looked += 1
        return self.card or {"reason": REASON}

    def train_here(self, start: Any, views: Any, settings: Any, **more: Any) -> Any:
        """Train on the processor, whichever device is asked for: there is no card."""
        self.backends.append(settings.backend)
        return self.train(start, views, settings.changed(backend="cpu"), **more)

    def run(self, *more: object) -> Answer:
        """Reconstruct."""
        return call(self.capsys, *self.command, *more)

    def stored(self) -> dict[str, Any]:
        """Return ``project.json``."""
        values: dict[str, Any] = json.loads((self.scene / "project.json").read_text(encoding="utf-8"))
        return values


@pytest.fixture
def computer(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Computer:
    photos, scene = write_photos(tmp_path / "photos"), tmp_path / "scene"
    cameras = write_cameras(tmp_path, {f"view_{view:02}.jpg": view for view in VIEWS})
    command: list[object] = ["reconstruct", photos, "--out", scene, "--preset", "test", "--no-objects"]
    made = Computer([*command, "--cameras", cameras], scene, capsys)
    monkeypatch.setattr("engine.rasterizer.devices.run_in_child", made.find)
    monkeypatch.setattr("engine.training.train", made.train_here)
    monkeypatch.setitem(CARD_SIZES, "test", CardSizes(50, 0, 48, 500))
    return made


def message(answer: Answer) -> str:
    (finished,) = answer.of_kind("finished")
    text: str = finished["message"]
    return text


def test_card_trains_without_being_told_and_the_scene_stays_done_without_it(computer: Computer) -> None:
    computer.card = CARD
    answer = computer.run()
    assert computer.backends == ["gpu"] and computer.looked == 1
    assert message(answer).endswith("It was trained on Card (Vulkan).")
    said = [event["message"] for event in answer.of_kind("progress")]
    assert "training on Card (Vulkan)" in said
    stored = computer.stored()
    assert stored["stages"]["training"]["figures"]["device"] == "Card (Vulkan)"
    assert stored["stages"]["training"]["figures"]["steps"] == 50
    assert stored["work_plan"]["device"]["backend"] == "gpu" and stored["work_plan"]["max_gaussians"] == 500
    report = (computer.scene / "report" / "report.html").read_text(encoding="utf-8")
    assert "trained on" in report and "Card (Vulkan)" in report

    computer.card = None
    again = computer.run()
    assert again.computed == [] and computer.looked == 1, "a finished training needs no look at the cards"
    assert message(again).endswith("It was trained on Card (Vulkan).")
    assert computer.stored()["forecast"] == stored["forecast"]


def test_without_a_card_the_end_and_the_report_say_why(computer: Computer) -> None:
    assert message(computer.run()).endswith(f"It was trained on the processor, because {REASON}.")
    assert computer.backends == ["cpu"]
    assert REASON in (computer.scene / "report" / "report.html").read_text(encoding="utf-8")
    computer.card = CARD
    assert computer.run().computed == [], "a scene of the processor stays done where there is a card"


def test_device_is_the_one_that_is_asked_for(computer: Computer) -> None:
    refused = computer.run("--device", "gpu")
    assert refused.error == f"{REASON}; use --device cpu."
    computer.card, computer.looked = CARD, 0
    assert message(computer.run("--device", "cpu")).endswith("It was trained on the processor.")
    assert computer.looked == 0 and computer.backends == ["cpu"]


def test_stages_before_training_do_not_look_for_a_card(computer: Computer) -> None:
    computer.card = CARD
    computer.run("--until", "cameras")
    assert computer.looked == 0
    computer.run("--until", "training")
    assert computer.looked == 1 and computer.backends == ["gpu"]


def test_training_interrupted_on_a_card_continues_on_the_processor_and_back(
    computer: Computer, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped_after(n: int) -> Callable[..., Any]:
        def train(start: Any, views: Any, settings: Any, *, should_stop: Any, **more: Any) -> Any:
            asked = iter(range(n))
            stop = lambda: next(asked, None) is None  # noqa: E731
            return computer.train_here(start, views, settings, should_stop=stop, **more)

        return train

    computer.card = CARD
    monkeypatch.setattr("engine.training.train", stopped_after(20))
    assert computer.run().code == Cancelled.exit_code
    computer.card = None
    assert computer.run().code == Cancelled.exit_code
    computer.card = CARD
    monkeypatch.setattr("engine.training.train", computer.train_here)
    answer = computer.run()
    said = [event["message"] for event in answer.of_kind("progress") if event["stage"] == "training"]
    assert "continued from a checkpoint" in said and "step 41 of 50" not in said[:2]
    assert computer.backends == ["gpu", "cpu", "gpu"]
    assert computer.stored()["stages"]["training"]["figures"]["steps"] == 50, "the sizes of the card are kept"
    assert len(list((computer.scene / "checkpoints").iterdir())) == 1


def test_card_that_stops_working_says_how_to_continue(computer: Computer, monkeypatch: pytest.MonkeyPatch) -> None:
    def lost(*_: object, **__: object) -> None:
        raise EnvironmentProblem("the graphics card Card stopped working (device lost); use the CPU.")

    computer.card = CARD
    monkeypatch.setattr("engine.training.train", lost)
    error = computer.run().error
    assert "Training on Card (Vulkan) stopped, because the graphics card Card stopped working (device lost)" in error
    assert "Run again to continue from the last checkpoint, or with --device cpu" in error


def test_training_that_is_begun_again_looks_for_a_card_then(computer: Computer, tmp_path: Path) -> None:
    computer.card = CARD
    computer.run()
    # Other cameras: what the plan took for finished is not.
    (tmp_path / "other").mkdir()
    other = write_cameras(tmp_path / "other", {f"view_{view:02}.jpg": view for view in VIEWS[:-1]})
    computer.run("--cameras", other)
    assert computer.looked == 2 and computer.backends == ["gpu", "gpu"]
