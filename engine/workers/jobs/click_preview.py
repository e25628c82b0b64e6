"""A process that shows what clicks mean while the user clicks: ``python -m engine show-clicks``. Does not import bpy.

It reads questions, one line of JSON each, and answers each with an event. Starting it takes seconds, so it runs as long
as the user clicks.
"""

from __future__ import annotations

import base64
import binascii
import contextlib
import json
import queue
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import IO, Any

import numpy as np

from ...core import events
from ...core.arrays import Mask
from ...core.engine_process import EngineProcess, events_in
from ...core.errors import DiskError
from ...core.files import check, parse_json
from .prompt_arguments import Click

_MAX_SIDE = 640
"""Longest side of a mask that is sent, in pixels: a viewport shows little more."""
_QUESTION = {"photo": str, "object": str, "clicks": [{"photo": str, "x": float, "y": float, "wanted": bool}]}
_MASK = {"width": int, "height": int, "bits": str}
_ANSWER = {"photo": str, "masks": {str: _MASK}}
_END_SECONDS = 2.0
"""Seconds that the process has to end after its input is closed."""


def click_question(photo: str, clicks: Sequence[Click], object_id: str = "") -> str:
    """Return the question for the masks of clicks on a photo as one line of JSON, without its end."""
    places = [{"photo": one.photo, "x": one.x, "y": one.y, "wanted": one.wanted} for one in clicks]
    return json.dumps({"photo": photo, "object": object_id, "clicks": places})


def read_question(line: str) -> tuple[str, list[Click], str]:
    """Return photo, clicks and id of the object (empty for none) of a question.

    Raises
    ------
    FormatError
        When the line is no question.
    """
    value = parse_json(line, _QUESTION, source="A question about clicks", advice="Update the add-on and the engine.")
    places = value["clicks"]
    return value["photo"], [Click(one["photo"], one["x"], one["y"], one["wanted"]) for one in places], value["object"]


def pack_mask(mask: Mask) -> dict[str, Any]:
    """Return a mask, bool [H, W], as JSON values, reduced to at most 640 pixels on its longer side."""
    step = max(1, -(-max(mask.shape) // _MAX_SIDE))
    small = np.ascontiguousarray(mask[step // 2 :: step, step // 2 :: step])
    bits = base64.b64encode(np.packbits(small).tobytes()).decode("ascii")
    return {"width": small.shape[1], "height": small.shape[0], "bits": bits}


@dataclass(frozen=True)
class ClickAnswer:
    """An answer.

    Attributes
    ----------
    photo : str
    masks : mapping of str to array of shape [H, W], bool
        ``wanted``, ``unwanted`` and ``present``, see `engine.objects.clicked`; empty when there is a `problem`.
    problem : str
        Why there are no masks, as a sentence; empty otherwise.
    """

    photo: str
    masks: Mapping[str, Mask]
    problem: str = ""


class ClickPreview:
    """The running process. Only the last question is of interest: those before it that wait are not asked.

    Parameters
    ----------
    environment : mapping
        Environment variables.
    """

    def __init__(self, command: Sequence[str], environment: Mapping[str, str]) -> None:
        self._answers: queue.SimpleQueue[ClickAnswer] = queue.SimpleQueue()
        self._waiting: str | None = None
        self._is_asked = self._is_closed = False
        self._process: EngineProcess | None = None
        try:
            self._process = EngineProcess.start(command, environment, self._read)
        except DiskError as error:
            self._answers.put(ClickAnswer("", {}, str(error)))

    def ask(self, question: str) -> None:
        """Ask a question of `click_question`, at once or after the one that is being answered."""
        if not self._is_closed:
            self._waiting = question
            self._send()

    def poll(self) -> ClickAnswer | None:
        """Return the newest answer since the last call; None when there is none. Does not wait."""
        newest: ClickAnswer | None = None
        if self._is_closed:
            return None
        with contextlib.suppress(queue.Empty):
            while True:
                newest = self._answers.get_nowait()
                self._is_asked = False
        self._send()
        return newest

    @property
    def is_working(self) -> bool:
        """Whether an answer is to come."""
        return self._is_asked or self._waiting is not None

    def close(self) -> None:
        """End the process."""
        process, self._process = self._process, None
        self._waiting, self._is_asked, self._is_closed = None, False, True
        if process is not None:
            # Blender does not wait for it.
            threading.Thread(target=process.close, args=(_END_SECONDS,), daemon=True).start()

    def _send(self) -> None:
        if self._waiting is None or self._is_asked or self._process is None:
            return
        question, self._waiting = self._waiting, None
        # That it has ended, `_read` reports.
        self._is_asked = self._process.send(f"{question}\n".encode())

    def _read(self, stream: IO[bytes]) -> None:
        has_error = False
        for event in events_in(stream):
            if isinstance(event, events.Finished):
                self._answers.put(_answer(event.outputs))
            elif isinstance(event, events.ErrorEvent):
                has_error = True
                self._answers.put(ClickAnswer("", {}, event.message))
        if not has_error:
            self._answers.put(ClickAnswer("", {}, "The engine stopped showing what clicks mean. Click Object again."))


def _answer(outputs: Mapping[str, Any]) -> ClickAnswer:
    if problem := outputs.get("problem"):
        return ClickAnswer("", {}, str(problem))
    if check(outputs, _ANSWER) is not None:
        return ClickAnswer("", {}, "The engine's answer about clicks cannot be read. Set up the engine again.")
    return ClickAnswer(outputs["photo"], {name: _unpacked(one) for name, one in outputs["masks"].items()})


def _unpacked(packed: Mapping[str, Any]) -> Mask:
    """Return the mask of `pack_mask`; nothing of one with another size than it states."""
    width, height = packed["width"], packed["height"]
    count = max(0, width) * max(0, height)
    try:
        bits = np.frombuffer(base64.b64decode(packed["bits"], validate=True), np.uint8)
    except (binascii.Error, ValueError):
        bits = np.empty(0, np.uint8)
    if not 0 < count <= _MAX_SIDE**2 or len(bits) != -(-count // 8):
        return np.zeros((1, 1), bool)
    return np.unpackbits(bits, count=count).reshape(height, width).astype(bool)
