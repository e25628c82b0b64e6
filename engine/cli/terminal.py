"""Output of events: JSON lines for programs, a progress bar for users, and the log of the project."""

from __future__ import annotations

import json
import logging
import os
import sys
import threading
from pathlib import Path
from typing import Any

from ..core.errors import Cancelled
from ..core.events import (
    ErrorEvent,
    Event,
    Finished,
    Metric,
    Progress,
    StageFinished,
    StageStarted,
    Warned,
    to_json_line,
)
from ..core.system import json_printable, printable
from ..core.visible_text import visible
from ..project.folder import PROJECT_FILE


class _LogLines(logging.Handler):
    """Writes log records of libraries into the log of the project as lines of kind ``log``; event readers skip them."""

    def __init__(self, output: EventOutput) -> None:
        super().__init__(logging.INFO)
        self._output = output

    def emit(self, record: logging.LogRecord) -> None:
        line = {
            "v": 1,
            "kind": "log",
            "time": record.created,
            "level": record.levelname,
            "message": record.getMessage(),
        }
        self._output.write_log(json.dumps(line, ensure_ascii=False))


_LINES_PER_STAGE = 10
"""Lines of progress of a stage where standard error is a file or a pipe, in which a bar would be thousands of lines."""


class EventOutput:
    """Prints events and appends them to the log, from any thread; nothing else prints.

    Parameters
    ----------
    json_lines : bool
        Events on standard output as JSON lines; otherwise sentences on standard error, and a progress bar if that is a
        terminal, or a line for every tenth of a stage.
    log : Path or None
        File to which every event is appended once its folder is a project.
    """

    def __init__(self, *, json_lines: bool, log: Path | None) -> None:
        self._json_lines = json_lines
        self._log = log
        self._bar: Any = None
        self._lines = 0
        self._metrics: dict[str, float] = {}
        # A line and its end are printed apart.
        self._whole = threading.RLock()
        self._handler = _LogLines(self)
        logging.getLogger().addHandler(self._handler)

    def close(self) -> None:
        """Close the progress bar and stop logging the records of libraries."""
        self._close_bar()
        logging.getLogger().removeHandler(self._handler)

    def write_log(self, line: str) -> None:
        """Append `line` to the log of the project, if the project exists already; never through a link of any kind."""
        with self._whole:
            if self._log is None or self._log.is_symlink() or not (self._log.parent / PROJECT_FILE).is_file():
                return
            try:
                with self._log.open("a", encoding="utf-8", errors="backslashreplace") as stream:
                    if os.fstat(stream.fileno()).st_nlink == 1:
                        stream.write(line + "\n")
            except OSError:
                # The stage itself reports a full disk; a failing log must not hide that message.
                self._log = None

    def __call__(self, event: Event) -> None:
        line = to_json_line(event)
        with self._whole:
            self.write_log(line)
            if self._json_lines:
                try:
                    print(json_printable(line, sys.stdout), flush=True)
                except BrokenPipeError:
                    # The reader (Blender) was closed; the job continues, and later events are in its log.
                    self._json_lines = False
                    sys.stdout = sys.stderr
            else:
                self._show(event)

    def _show(self, event: Event) -> None:
        if isinstance(event, StageStarted):
            self._close_bar()
        elif isinstance(event, Progress):
            self._progress(event)
        elif isinstance(event, Metric):
            # Shown with the next progress: alone, several would cover one another.
            self._metrics[event.name] = event.value
        elif isinstance(event, StageFinished):
            self._close_bar()
            outcome = "unchanged, kept" if event.reused else f"done in {event.seconds:.1f} s"
            self._print(f"{event.stage}: {outcome}")
        elif isinstance(event, Warned):
            self._print(f"Note: {event.message}")
        elif isinstance(event, ErrorEvent):
            self._close_bar()
            # Stopping on request is no error.
            self._print(event.message if event.error == Cancelled.__name__ else f"Error: {event.message}")
        elif isinstance(event, Finished):
            self._close_bar()
            if event.message:
                # Lines and columns of the plan and of other tables.
                print(printable(visible(event.message, keep="\n\t"), sys.stdout))

    def _progress(self, event: Progress) -> None:
        left = "" if event.seconds_left is None else f"{event.seconds_left:.0f} s left"
        metrics = (f"{name} {value:,.0f}" if value.is_integer() else f"{name} {value:.4g}"
                   for name, value in self._metrics.items())  # fmt: skip
        text = ", ".join(filter(None, (left, event.message, *metrics)))
        if sys.stderr.isatty():
            self._move_bar(event, self._shown(text))
        elif event.fraction * _LINES_PER_STAGE >= self._lines:
            self._lines = int(event.fraction * _LINES_PER_STAGE) + 1
            self._print(f"{event.stage} {100 * event.fraction:.0f}%" + (f": {text}" if text else ""))

    def _move_bar(self, event: Progress, text: str) -> None:
        from tqdm import tqdm

        if self._bar is None:
            self._bar = tqdm(
                total=100,
                desc=self._shown(event.stage),
                file=sys.stderr,
                unit="",
                bar_format="{desc:>9} {percentage:3.0f}%|{bar}| {unit}",  # the postfix would begin with a comma
            )
        self._bar.n = round(100 * event.fraction)
        self._bar.unit = text
        self._bar.refresh()

    def _close_bar(self) -> None:
        """End the progress of a stage."""
        self._lines, self._metrics = 0, {}
        if self._bar is not None:
            self._bar.close()
            self._bar = None

    @staticmethod
    def _shown(text: str) -> str:
        return printable(visible(text), sys.stderr)

    def _print(self, sentence: str) -> None:
        sentence = self._shown(sentence)
        if self._bar is None:
            print(sentence, file=sys.stderr)
        else:
            self._bar.write(sentence, file=sys.stderr)
