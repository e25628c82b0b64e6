"""The process that reads the damaged inputs of one reader, and measures each: CPU seconds and peak of memory."""

from __future__ import annotations

import gzip
import logging
import os
import resource
import signal
import sys
import time
import traceback
import warnings
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from .fuzz_inputs import Workplace, outcome_of
from .reader import Reader
from .readers import READERS

MAX_SECONDS = 10.0
"""CPU time that a reader may take for an input."""
MAX_BYTES = 256 << 20
"""Memory that a reader may take beside twice the decoded size of its input."""
_ADDRESS_SPACE = 12 << 30
_DEFLATE_RATIO = 1032
"""No deflated stream decodes to more than this many times its size."""


@dataclass(frozen=True)
class Measured:
    """What reading one input took.

    Attributes
    ----------
    number : int
        Of the input.
    kind, error : str
        See `fuzz_inputs.Outcome`. An input that took too much time or memory has an error of its own.
    seconds : float
        CPU time, with that of child processes.
    n_bytes : int
        Peak of memory above that before the input; of a child process above that of the valid input, if larger.
    """

    number: int
    kind: str
    error: str
    seconds: float
    n_bytes: int


def serve(name: str, seed: int, first: int, seconds: float, folder: str, answers: Connection) -> None:
    """Read inputs from number `first` on for `seconds`, and send a `Measured` for each; text when this module fails."""
    _set_up()
    try:
        _read_inputs(next(reader for reader in READERS if reader.name == name), seed, first, seconds, folder, answers)
    except Exception:
        answers.send(traceback.format_exc())
    # Threads of libraries would end slowly.
    os._exit(0)


def _read_inputs(reader: Reader, seed: int, first: int, seconds: float, folder: str, answers: Connection) -> None:
    workplace = Workplace(reader, Path(folder))
    # The first reading imports what the reader needs, the second shows what it takes.
    for _ in range(2):
        valid = _measured(workplace, -1, 0)
        workplace.restore()
        if valid.kind != "accepted":
            raise RuntimeError(f"{reader.name} does not accept its valid input: {valid.error or valid.kind}")
    # A child process imports about the same as this one.
    child_base = _peak_of_children() or _reset_peak()
    deadline, number = time.monotonic() + seconds, first
    while time.monotonic() < deadline:
        damaged = workplace.damage(seed, number)
        answers.send(_measured(workplace, number, child_base))
        workplace.heal(damaged)
        number += 1


def _set_up() -> None:
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)
    # Libraries print about damaged files on both.
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    os.dup2(null, 2)
    resource.setrlimit(resource.RLIMIT_AS, (_ADDRESS_SPACE, _ADDRESS_SPACE))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    sys.setswitchinterval(0.005)


def _measured(workplace: Workplace, number: int, child_base: int) -> Measured:
    before, children_before, cpu = _reset_peak(), _peak_of_children(), _cpu_seconds()
    # Its default action ends the process, also inside of a library.
    signal.setitimer(signal.ITIMER_PROF, MAX_SECONDS + 2.0)
    outcome = outcome_of(workplace.reader, workplace.folder)
    signal.setitimer(signal.ITIMER_PROF, 0.0)
    seconds, n_bytes = _cpu_seconds() - cpu, _peak() - before
    children = _peak_of_children()
    if children > children_before:
        n_bytes = max(n_bytes, children - child_base)
    kind, error = outcome.kind, outcome.error
    if seconds > MAX_SECONDS:
        error = f"it took {seconds:.1f} s"
    elif n_bytes > MAX_BYTES:
        decoded = max(_decoded_size(workplace.folder), sum(_array_sizes(outcome.result)))
        if n_bytes > MAX_BYTES + 2 * decoded:
            error = f"it took {n_bytes >> 20} MB for {decoded >> 20} MB"
    return Measured(number, kind, error, seconds, n_bytes)


def _cpu_seconds() -> float:
    own, children = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime


def _peak_of_children() -> int:
    """Return the largest peak of memory of all child processes that have ended, bytes."""
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss << 10


def _reset_peak() -> int:
    """Set the peak of memory of this process to its present memory, and return it in bytes. Linux only."""
    Path("/proc/self/clear_refs").write_text("5")
    return _peak()


def _peak() -> int:
    status = Path("/proc/self/status").read_bytes()
    return int(status[status.index(b"VmHWM:") + 6 :].split(maxsplit=1)[0]) << 10


# ---- the decoded size of an input, computed only for those that took much memory


def _decoded_size(folder: Path) -> int:
    return sum(_decoded_size_of_file(path) for path in folder.rglob("*") if path.is_file())


def _decoded_size_of_file(path: Path) -> int:
    from PIL import Image

    size = path.stat().st_size
    try:
        if zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as archive:
                return sum(min(one.file_size, _DEFLATE_RATIO * (one.compress_size + 64)) for one in archive.infolist())
        if path.suffix == ".tgz":
            with gzip.open(path) as stream:
                return sum(len(chunk) for chunk in iter(lambda: stream.read(1 << 20), b""))
        if path.suffix in (".jpg", ".png", ".tif", ".webp", ".heic"):
            with Image.open(path) as picture:
                return picture.width * picture.height * 4
    # The file is damaged: it has no other size than its own.
    except Exception:  # noqa: BLE001
        return size
    return size


def _array_sizes(result: Any) -> Iterator[int]:
    if hasattr(result, "nbytes"):
        yield int(result.nbytes)
    elif is_dataclass(result) and not isinstance(result, type):
        for field in fields(result):
            yield from _array_sizes(getattr(result, field.name))
    elif isinstance(result, dict):
        for value in result.values():
            yield from _array_sizes(value)
    elif isinstance(result, list | tuple):
        for value in result[:10_000]:
            yield from _array_sizes(value)
