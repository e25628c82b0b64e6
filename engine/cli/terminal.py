"""Output of events: JSON lines for programs, a progress bar for users, and the log of the project."""

from __future__ import annotations

import json
import logging
import os
import sys
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


class EventOutput:
    """Prints events and appends them to the log; nothing else prints.

    Parameters
    ----------
    json_lines : bool
        Events on standard output as JSON lines; otherwise a progress bar and sentences on standard error.
    log : Path or None
        File to which every event is appended once its folder is a project.
    """

    def __init__(self, *, json_lines: bool, log: Path | None) -> None:
        self._json_lines = json_lines
        self._log = log
        self._bar: Any = None
        self._handler = _LogLines(self)
        logging.getLogger().addHandler(self._handler)

    def close(self) -> None:
        """Close the progress bar and stop logging the records of libraries."""
        self._close_bar()
        logging.getLogger().removeHandler(self._handler)

    def write_log(self, line: str) -> None:
        """Append `line` to the log of the project, if the project exists already; never through a link of any kind."""
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
        elif isinstance(event, Metric) and self._bar is not None:
            self._bar.set_postfix_str(self._shown(f"{event.name} {event.value:.4g}"))
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
        from tqdm import tqdm

        if self._bar is None:
            self._bar = tqdm(
                total=100,
                desc=self._shown(event.stage),
                file=sys.stderr,
                bar_format="{desc:>9} {percentage:3.0f}%|{bar}| {postfix}",
            )
        self._bar.n = round(100 * event.fraction)
        left = "" if event.seconds_left is None else f"{event.seconds_left:.0f} s left "
        self._bar.set_postfix_str(self._shown(left + event.message))

    def _close_bar(self) -> None:
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
