"""`reconstruct` trains on a card without being told, says so, and is done or continues where there is none."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from engine.core.errors import Cancelled, EnvironmentProblem
from tests.engine.command_line import Answer
from tests.engine.museum import VIEWS, write_cameras

from .conftest import CARD, REASON, Computer


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
