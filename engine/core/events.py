"""The progress protocol: one JSON line per event, written by the engine, read by Blender, tests and users' scripts.

Packages get ``emit`` and ``should_stop`` as arguments and never print. A reader skips kinds it does not know.
Standard library only: Blender imports this module too.
"""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable
from dataclasses import MISSING, asdict, dataclass, field, fields, replace
from typing import Any, ClassVar

from .errors import FormatError
from .files import Schema, finite_or_null, optional, parse_json

PROTOCOL_VERSION = 1


@dataclass(frozen=True)
class Event:
    """Base of all events. ``time`` is seconds since the epoch."""

    kind: ClassVar[str] = ""
    time: float = field(default_factory=time.time, kw_only=True)


@dataclass(frozen=True)
class StageStarted(Event):
    """A stage of the pipeline begins: ``photos``, ``cameras``, ``masks``, ``training``, ``objects``, ``report``..."""

    kind: ClassVar[str] = "stage_started"
    stage: str


@dataclass(frozen=True)
class StageFinished(Event):
    """A stage ended. ``reused`` is true when its inputs had not changed and nothing was computed."""

    kind: ClassVar[str] = "stage_finished"
    stage: str
    seconds: float
    reused: bool = False


@dataclass(frozen=True)
class Progress(Event):
    """Progress of a stage: ``fraction`` in [0, 1]; ``seconds_left`` of this stage, None when unknown."""

    kind: ClassVar[str] = "progress"
    stage: str
    fraction: float
    seconds_left: float | None = None
    message: str = ""


@dataclass(frozen=True)
class Metric(Event):
    """A measured number, such as ``psnr`` at a training step, ``seconds`` after the stage began where that is known."""

    kind: ClassVar[str] = "metric"
    stage: str
    name: str
    value: float
    step: int | None = None
    seconds: float | None = None


@dataclass(frozen=True)
class Preview(Event):
    """A preview picture was written to ``path``."""

    kind: ClassVar[str] = "preview"
    stage: str
    path: str


@dataclass(frozen=True)
class Warned(Event):
    """A message for the user that does not stop the work."""

    kind: ClassVar[str] = "warning"
    message: str


@dataclass(frozen=True)
class ErrorEvent(Event):
    """The work stopped. ``message`` is one sentence for the user, ``error`` the name of the exception type."""

    kind: ClassVar[str] = "error"
    message: str
    error: str = "HeritageError"


@dataclass(frozen=True)
class Finished(Event):
    """The command succeeded.

    ``outputs`` maps names to paths and values, ``parts`` the parts of the command, such as ``training/imports``, to
    wall and CPU seconds; see `engine.core.parts`.
    """

    kind: ClassVar[str] = "finished"
    message: str = ""
    outputs: dict[str, Any] = field(default_factory=dict)
    parts: dict[str, Any] = field(default_factory=dict)


Emit = Callable[[Event], None]
StopCheck = Callable[[], bool]

_KINDS: dict[str, type[Event]] = {
    cls.kind: cls for cls in (StageStarted, StageFinished, Progress, Metric, Preview, Warned, ErrorEvent, Finished)
}

_SCHEMAS_OF_TYPES: dict[str, Schema] = {
    "str": str,
    "bool": bool,
    "float": float,
    "float | None": (float, None),
    "int | None": (int, None),
    "dict[str, Any]": dict,
}
"""The JSON type of a field of each type."""


def _schema(cls: type[Event]) -> Schema:
    schema: dict[str, Any] = {}
    for one in fields(cls):
        expected = _SCHEMAS_OF_TYPES[str(one.type)]
        is_required = one.default is MISSING and one.default_factory is MISSING
        schema[one.name] = expected if is_required else optional(expected)
    return schema


_SCHEMAS: dict[str, Schema] = {kind: _schema(cls) for kind, cls in _KINDS.items()}
"""The schema of an event of each kind in JSON."""
_SOURCE = "the event"
_SURROGATE = re.compile(r"[\ud800-\udfff]")


def to_json_line(event: Event) -> str:
    """Return `event` as one line of JSON without the newline.

    A number that is not finite becomes null. A byte of a file name that is not UTF-8 becomes ``\\udcff``, as text.
    """
    values = finite_or_null({"v": PROTOCOL_VERSION, "kind": event.kind, **asdict(event)})
    line = json.dumps(values, ensure_ascii=False)
    return _SURROGATE.sub(lambda found: f"\\\\u{ord(found[0]):04x}", line)


def from_json_line(line: str) -> Event | None:
    """Return the event on `line`, or None for a line that this reader does not know.

    Such a line is damaged, half-written, longer than 16 MB, or of another kind or version. The fields of an event have
    the types that its class states; numbers are finite, fractions in [0, 1].
    """
    try:
        head = parse_json(line, {"v": int, "kind": str}, source=_SOURCE, advice="")
        cls = _KINDS.get(head["kind"])
        if cls is None or head["v"] != PROTOCOL_VERSION:
            return None
        data = parse_json(line, _SCHEMAS[cls.kind], source=_SOURCE, advice="")
    except FormatError:
        return None
    values = {}
    for one in fields(cls):
        if one.name in data:
            value = data[one.name]
            values[one.name] = float(value) if isinstance(value, int) and "float" in str(one.type) else value
    if "fraction" in values:
        values["fraction"] = min(max(values["fraction"], 0.0), 1.0)
    return cls(**values)


def ignore_events(event: Event) -> None:
    """Ignore `event`; an `Emit` for callers that need no progress."""


def part_of(emit: Emit, number: int, count: int) -> Emit:
    """Return `emit` for part `number` of `count` equal parts: progress of the part becomes progress of the whole."""

    def emit_part(event: Event) -> None:
        if isinstance(event, Progress):
            event = replace(event, fraction=(number + event.fraction) / count, seconds_left=None)
        emit(event)

    return emit_part


def never_stop() -> bool:
    """Return False; a `StopCheck` that lets the work run to its end."""
    return False
