"""Bounds of memory and time for decoding a photo: a photo can only reject itself.

What takes little memory is decoded in this process; larger photos are decoded in a child process with limits of memory
and CPU time. All threads share one budget, see `memory_budget`.
"""

from __future__ import annotations

import contextlib
import importlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from ..core.child_process import ChildFailure, run_in_child
from ..core.errors import PhotoError
from ..core.events import StopCheck, never_stop
from ..core.system import cpu_seconds_limited
from ..core.visible_text import visible
from .memory_budget import DECODING
from .pixels import PhotoHeader, photo_errors

_MAX_BYTES_HERE = 512 << 20
"""Largest memory of a photo that is decoded in this process."""
_CHILD_BYTES = 192 << 20
"""Memory of a child process in addition to the photo."""
_CPU_SECONDS = 8.0
"""CPU time of a child process for a file of up to 10 MB."""
_CPU_SECONDS_PER_BYTE = 0.5e-6
"""The same per byte of a larger file."""
_WALL_SECONDS_PER_CPU_SECOND = 10.0
"""The computer may be busy, above all with other photos."""


@contextlib.contextmanager
def reserved(path: Path, *headers: PhotoHeader) -> Iterator[None]:
    """Reserve the memory for decoding the photo at `path`, and its mask if any; raises `PhotoError` when too much."""
    photo = headers[0]
    what = f"{visible(path.name)} has {photo.width} x {photo.height} pixels"
    with DECODING.reserved(_sum_of_bytes(headers), what):
        yield


def is_large(*headers: PhotoHeader) -> bool:
    """Return whether decoding these files together takes so much memory that a child process must do it."""
    return _sum_of_bytes(headers) > _MAX_BYTES_HERE


def call_within_bounds(
    function: Callable[[str], Any],
    path: Path,
    header: PhotoHeader,
    *,
    should_stop: StopCheck = never_stop,
) -> Any:
    """Return ``function(path)``, called here or in a child process.

    Parameters
    ----------
    function : callable
        Public function of a module of this package. Its result is a JSON value.
    path : Path
        The photo, which `function` gets as text.
    header : PhotoHeader
        Of the photo.
    should_stop : StopCheck
        Asked while a child process works.

    Raises
    ------
    PhotoError
        When the photo cannot be decoded within the bounds.
    """
    with reserved(path, header):
        if not is_large(header):
            with photo_errors(path):
                return function(str(path))
        return call_in_child(function, path, header, should_stop=should_stop)


def call_in_child(
    function: Callable[..., Any],
    path: Path,
    *headers: PhotoHeader,
    should_stop: StopCheck = never_stop,
    **arguments: Any,
) -> Any:
    """Return ``function(path, **arguments)``, called in a child process with limits; see `call_within_bounds`.

    The arguments are JSON values.

    Raises
    ------
    PhotoError
        When the file is damaged, or takes more memory or time than one of its size needs.
    """
    name = visible(path.name)
    cpu_seconds = _CPU_SECONDS + _CPU_SECONDS_PER_BYTE * max(0, path.stat().st_size - 10_000_000)
    request = {
        "module": function.__module__.rpartition(".")[2],
        "name": function.__name__,
        "path": str(path),
        "cpu_seconds": cpu_seconds,
        "arguments": arguments,
    }
    try:
        return run_in_child(
            f"photos.bounded:{limited_call.__name__}",
            request,
            max_memory=_sum_of_bytes(headers) + _CHILD_BYTES,
            max_seconds=_WALL_SECONDS_PER_CPU_SECOND * cpu_seconds,
            what=f"reading {name}",
            should_stop=should_stop,
        )
    except ChildFailure as error:
        if error.reason == "memory":
            raise PhotoError(
                f"{name} takes more memory than the {_sum_of_bytes(headers) / 1e9:.1f} GB for its "
                f"{headers[0].width} x {headers[0].height} pixels. Reduce its size or save it again as JPEG."
            ) from error
        if error.reason == "time" or "SIGXCPU" in str(error):
            raise PhotoError(f"{name} takes too long to read. Save it again as JPEG, or reduce its size.") from error
        raise PhotoError(f"{name} is damaged and cannot be read. Copy it again from the camera.") from error


def limited_call(module: str, name: str, path: str, cpu_seconds: float, arguments: dict[str, Any]) -> Any:
    """Call a function of this package within `cpu_seconds` of CPU time; the child process calls this."""
    cpu_seconds_limited(cpu_seconds)
    function = getattr(importlib.import_module(f"{__package__}.{module}"), name)
    with photo_errors(Path(path)):
        return function(path, **arguments)


def _sum_of_bytes(headers: tuple[PhotoHeader, ...]) -> int:
    return sum(header.n_bytes for header in headers)
