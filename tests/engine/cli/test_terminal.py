"""What comes from file names and files is shown as text: it cannot act on the terminal, and cannot stop a run."""

from __future__ import annotations

import io
import json
import sys
import threading
from pathlib import Path

import pytest

from engine.cli.terminal import EventOutput
from engine.core.events import ErrorEvent, Event, Finished, Metric, Progress, StageFinished, StageStarted, Warned
from engine.core.visible_text import visible
from engine.project.folder import ProjectFolder

HOSTILE = "\x1b]0;owned\x07\x1b[31mred\r\n\x9b2J\u202egpj.exe\u2066\u2028\udce9"


class Stream(io.TextIOWrapper):
    """A terminal, or a file, of some encoding."""

    def __init__(self, encoding: str, *, terminal: bool) -> None:
        self.raw_bytes = io.BytesIO()
        self.terminal = terminal
        super().__init__(self.raw_bytes, encoding=encoding, errors="strict", write_through=True)

    def isatty(self) -> bool:
        return self.terminal

    @property
    def text(self) -> str:
        return self.raw_bytes.getvalue().decode(self.encoding)


def shown(
    monkeypatch: pytest.MonkeyPatch,
    *events: Event,
    encoding: str = "utf-8",
    json_lines: bool = False,
    log: Path | None = None,
    terminal: bool = False,
) -> tuple[str, str]:
    """Return what standard output and standard error show."""
    output, errors = Stream(encoding, terminal=terminal), Stream(encoding, terminal=terminal)
    monkeypatch.setattr(sys, "stdout", output)
    monkeypatch.setattr(sys, "stderr", errors)
    printer = EventOutput(json_lines=json_lines, log=log)
    for event in events:
        printer(event)
    printer.close()
    return output.text, errors.text


def test_events_and_log_records_of_several_threads_are_whole_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class InPieces(Stream):
        """Other threads go on within a line, as they do while the system writes."""

        def write(self, text: str) -> int:
            return sum(super(InPieces, self).write(character) for character in text)

    output, log = InPieces("utf-8", terminal=False), tmp_path / "log.jsonl"
    monkeypatch.setattr(sys, "stdout", output)
    ProjectFolder.create(tmp_path)
    printer = EventOutput(json_lines=True, log=log)

    def many(number: int) -> None:
        for step in range(200):
            printer(Progress(f"stage {number}", step / 200, None, "x"))

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        threads = [threading.Thread(target=many, args=(number,)) for number in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(interval)
        printer.close()
    for text in (output.text, log.read_text(encoding="utf-8")):
        stages = [json.loads(line)["stage"] for line in text.splitlines()]
        assert sorted(stages) == ["stage 0"] * 200 + ["stage 1"] * 200


def test_hidden_characters_become_visible() -> None:
    assert visible(HOSTILE) == (
        r"\x1b]0;owned\x07\x1b[31mred\r\n\x9b2J\u202egpj.exe\u2066\u2028\udce9"
    )  # fmt: skip
    assert visible("Büste 花瓶\n\t", keep="\n\t") == "Büste 花瓶\n\t"


def every_event(text: str) -> tuple[Event, ...]:
    return (
        StageStarted(text), Progress(text, 0.5, 3.0, text), Metric(text, text, 1.0), Warned(text),
        StageFinished(text, 1.0), Warned(text), ErrorEvent(text, "PhotoError"), Finished(text),
    )  # fmt: skip


@pytest.mark.parametrize("terminal", [True, False])
@pytest.mark.parametrize("encoding", ["utf-8", "ascii", "cp1252", "latin-1"])
def test_no_event_sends_a_control_character_to_the_terminal(
    monkeypatch: pytest.MonkeyPatch, encoding: str, terminal: bool
) -> None:
    hostile = HOSTILE.replace("\n", "")
    plain = "".join(shown(monkeypatch, *every_event("Büste"), encoding=encoding, terminal=terminal))
    text = "".join(shown(monkeypatch, *every_event(hostile), encoding=encoding, terminal=terminal))
    # The progress bar itself moves the cursor with these.
    own = set(plain)
    assert "\x1b[31m" not in text
    assert not {"\x07", "\x9b", "\u202e", "\u2066", "\u2028", "\udce9"} & (set(text) - own)
    assert r"\x1b[31mred" in text and r"\udce9" in text


@pytest.mark.parametrize("encoding", ["ascii", "cp1252"])
def test_a_terminal_that_cannot_show_a_name_does_not_stop_the_run(
    monkeypatch: pytest.MonkeyPatch, encoding: str
) -> None:
    out, err = shown(monkeypatch, Finished("花瓶"), Warned("花瓶"), encoding=encoding)
    assert out == "\\u82b1\\u74f6\n" and err == "Note: \\u82b1\\u74f6\n"


@pytest.mark.parametrize("encoding", ["utf-8", "ascii", "cp1252"])
def test_lines_of_json_are_complete_in_every_encoding(monkeypatch: pytest.MonkeyPatch, encoding: str) -> None:
    text = "花瓶 ü \U0001f3fa \x1b\udce9"
    out, _ = shown(monkeypatch, Warned(text), encoding=encoding, json_lines=True)
    assert "\x1b" not in out and out.count("\n") == 1
    assert json.loads(out)["message"] == text.replace("\udce9", "\\udce9")


def test_a_name_that_is_not_utf_8_is_logged(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    project = ProjectFolder.create(tmp_path / "project")
    log = project.path / "log.jsonl"
    printer = EventOutput(json_lines=False, log=log)
    printer.write_log("raw \udce9")
    printer.close()
    shown(monkeypatch, Warned("name \udce9"), log=log)
    raw, line = log.read_text(encoding="utf-8").splitlines()
    assert raw == "raw \\udce9"
    assert json.loads(line)["message"] == "name \\udce9"


def test_lines_of_a_table_stay_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    out, _ = shown(monkeypatch, Finished("a\tb\nc"))
    assert out == "a\tb\nc\n"


def steps(n: int) -> list[Event]:
    """Return the events of a stage of n steps."""
    events: list[Event] = [StageStarted("training")]
    for step in range(n + 1):
        events += [Metric("training", "loss", 0.125), Metric("training", "gaussians", 40_000.0)]
        events.append(Progress("training", step / n, float(n - step), f"step {step} of {n}"))
    return [*events, StageFinished("training", 2.0)]


def test_a_file_gets_a_line_for_every_tenth_of_a_stage(monkeypatch: pytest.MonkeyPatch) -> None:
    _, err = shown(monkeypatch, *steps(1000), *steps(3))
    lines = err.splitlines()
    assert lines[:2] == [
        "training 0%: 1000 s left, step 0 of 1000, loss 0.125, gaussians 40,000",
        "training 10%: 900 s left, step 100 of 1000, loss 0.125, gaussians 40,000",
    ]
    assert [line.split(":")[0] for line in lines[:11]] == [f"training {10 * n}%" for n in range(11)]
    assert lines[11] == lines[-1] == "training: done in 2.0 s"
    assert [line.split(":")[0] for line in lines[12:-1]] == [
        "training 0%",
        "training 33%",
        "training 67%",
        "training 100%",
    ]


def test_a_terminal_gets_one_bar_with_all_that_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    _, err = shown(monkeypatch, *steps(10), terminal=True)
    drawn = [one.strip() for one in err.split("\r")]
    assert any(
        one.endswith("| 5 s left, step 5 of 10, loss 0.125, gaussians 40,000") and "50%|" in one for one in drawn
    )
    assert err.count("\n") == 2, "the bar stays on its line, and the sentence of the end has one"
