"""The progress protocol."""

from __future__ import annotations

import json

import pytest

from engine.core.events import (
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


DAMAGED = [
    '{"v":1,"kind":[]}',
    '{"v":1,"kind":{}}',
    '{"v":1,"kind":null}',
    '{"v":[],"kind":"warning","message":"x"}',
    '{"v":true,"kind":"warning","message":"x"}',
    '{"v":1,"kind":"warning","message":7}',
    '{"v":1,"kind":"warning","message":"x","time":"now"}',
    '{"v":1,"kind":"warning","message":"\\ud800"}',
    '{"v":1,"kind":"progress","stage":"masks","fraction":NaN}',
    '{"v":1,"kind":"progress","stage":"masks","fraction":1e999}',
    '{"v":1,"kind":"progress","stage":"masks","fraction":"0.5"}',
    '{"v":1,"kind":"progress","stage":"masks","fraction":true}',
    '{"v":1,"kind":"progress","stage":["masks"],"fraction":0.5}',
    '{"v":1,"kind":"progress","stage":"masks","fraction":0.5,"seconds_left":"soon"}',
    '{"v":1,"kind":"metric","stage":"s","name":"psnr","value":1,"step":1.5}',
    '{"v":1,"kind":"metric","stage":"s","name":"psnr","value":1' + "0" * 400 + "}",
    '{"v":1,"kind":"metric","stage":"s","name":"psnr","value":1' + "0" * 5000 + "}",
    '{"v":1,"kind":"finished","outputs":[]}',
    '{"v":1,"kind":"finished","message":null}',
    '{"v":1,"kind":"stage_finished","stage":"masks","seconds":1,"reused":"no"}',
    "[" * 100_000,
    '{"v":1,"kind":"warning","message":"x","more":' + "[" * 100_000 + "]" * 100_000 + "}",
    '{"v":1,"kind":"warning","message":"' + "x" * (17 << 20) + '"}',
    "\udce9",
    "\x00",
    "",
    "7",
]


@pytest.mark.parametrize("line", DAMAGED, ids=range(len(DAMAGED)))
def test_a_damaged_line_is_skipped(line: str) -> None:
    assert from_json_line(line) is None


def test_whole_numbers_become_floats_and_fractions_stay_between_0_and_1() -> None:
    event = from_json_line('{"v":1,"kind":"progress","stage":"masks","fraction":7,"seconds_left":3,"time":5}')
    assert event == Progress("masks", 1.0, 3.0, time=5.0)
    assert all(type(value) is float for value in (event.fraction, event.seconds_left, event.time))
    low = from_json_line('{"v":1,"kind":"progress","stage":"masks","fraction":-1e300}')
    assert isinstance(low, Progress) and low.fraction == 0.0


def test_a_number_that_is_not_finite_is_written_as_null() -> None:
    line = to_json_line(Progress("training", 0.5, float("nan"), "step 1"))
    assert json.loads(line)["seconds_left"] is None
    read = from_json_line(line)
    assert isinstance(read, Progress) and read.seconds_left is None


def test_a_name_that_is_not_utf_8_can_be_sent() -> None:
    line = to_json_line(Warned("a\udce9.jpg is not used"))
    line.encode("utf-8")
    read = from_json_line(line)
    assert isinstance(read, Warned) and read.message == "a\\udce9.jpg is not used"
