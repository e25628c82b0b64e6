"""The progress protocol."""

from __future__ import annotations

import json

import pytest

from engine.events import (
    ErrorEvent,
    Event,
    Finished,
    Metric,
    Preview,
    Progress,
    StageFinished,
    StageStarted,
    Warned,
    from_json_line,
    part_of,
    to_json_line,
)


@pytest.mark.parametrize(
    "event",
    [
        StageStarted("photos"),
        StageFinished("photos", 1.5, reused=True),
        Progress("masks", 0.5, 12.0, "Büste.jpg"),
        Metric("training", "psnr", 25.5, 100, 12.5),
        Preview("training", "checkpoints/preview.png"),
        Warned("one photo is dark"),
        ErrorEvent("No photos.", "PhotoError"),
        Finished("done", {"objects": ["vase"]}),
    ],
)
def test_every_event_survives_its_line(event: Event) -> None:
    line = to_json_line(event)
    assert "\n" not in line
    assert from_json_line(line) == event


def test_reader_skips_what_it_does_not_know() -> None:
    assert from_json_line('{"v": 1, "kind": "from the future"}') is None
    assert from_json_line('{"v": 99, "kind": "progress"}') is None
    assert from_json_line('{"v": 1, "kind": "prog') is None
    assert from_json_line("null") is None
    assert from_json_line('{"v": 1, "kind": "progress"}') is None


def test_reader_ignores_new_fields_of_known_kinds() -> None:
    data = json.loads(to_json_line(Warned("x")))
    assert from_json_line(json.dumps({**data, "colour": "red"})) == Warned("x", time=data["time"])


def test_progress_of_a_part_is_told_as_that_of_the_whole_and_the_rest_as_it_is() -> None:
    heard: list[Event] = []
    emit = part_of(heard.append, 1, 4)
    emit(Progress("objects", 0.5, seconds_left=3.0, message="vase"))
    emit(Warned("look"))
    first, second = heard
    assert isinstance(first, Progress) and isinstance(second, Warned)
    assert (first.fraction, first.seconds_left, first.message) == (0.375, None, "vase")
    assert second.message == "look"
