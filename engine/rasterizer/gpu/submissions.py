"""Dispatches of kernels in submissions of bounded time.

A driver resets a card that works on one submission for seconds; integrated cards draw the screen meanwhile and are reset
first. The first run of a list of dispatches measures each of them, in a submission of its own, unless what was measured of
the same stages tells that all of them fit into one. Later runs join as many as the limit allows, and split a dispatch that
is longer alone, where its kernel can start at any workgroup.
"""

from __future__ import annotations

import functools
import itertools
import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from .adapters import Gpu
from .constants import Constants
from .passes import KernelPass, address_of

_COPY = 0x4 | 0x8  # COPY_SRC | COPY_DST of WebGPU

Work = tuple[int, int]
"""Numbers of Gaussians and of tiles."""

Count = int | Callable[[], int]
"""A number, or what gives it when the work is queued, because it changes with the number of Gaussians."""

LIMIT_S = 0.2
"""Longest submission, seconds. Watchdogs wait for 2 s (Windows, Linux) or more; the picture on the screen stands still
meanwhile."""

FILL = 0.5
"""Share of the limit that forecasts fill, because other cameras see more Gaussians."""

FIRST_GROUPS = 128
"""Workgroups of the first part of a dispatch that was never measured. Parts grow while they are shorter than the limit."""

REMEASURED = 1.5
"""Growth of the work after which forecast times are raised."""

_OVERHEAD_RUNS = 3

_SHORTEST_S = 1e-6
"""Time of a dispatch that takes no longer than the measurement itself."""

MEASURE_INTERVAL = 64
"""Runs after which dispatches are measured again, if together they take more than a tenth of the limit."""


@dataclass(frozen=True)
class Dispatch:
    """A dispatch: `count` workgroups, or as many as the buffer of dispatches says from entry `indirect` on.

    `part` returns the dispatch of some of the workgroups, from a first one to an end; None if that is not possible.
    """

    stage: str
    pipeline: Any
    bindings: Any
    count: Count
    indirect: int = -1
    part: Callable[[int, int], Dispatch] | None = None

    @property
    def n_groups(self) -> int:
        """Number of workgroups; 1 where only the card knows."""
        if self.indirect >= 0:
            return 1
        return self.count() if callable(self.count) else self.count

    @property
    def groups(self) -> tuple[int, int]:
        """Workgroups along x and y; kernels leave out those beyond their number."""
        n = max(1, self.n_groups)
        x = min(n, 65535)
        return x, -(-n // x)

    @functools.cached_property
    def addresses(self) -> tuple[int, int]:
        """Addresses of the pipeline and of the bindings."""
        return address_of(self.pipeline), address_of(self.bindings)

    def parts(self, n: int) -> list[Dispatch]:
        """Return the same work in at most `n` dispatches."""
        if self.part is None or n <= 1:
            return [self]
        size = -(-self.n_groups // min(n, self.n_groups))
        return [self.part(at, min(at + size, self.n_groups)) for at in range(0, self.n_groups, size)]


@dataclass
class Batch:
    """A submission: dispatches, and of each the number of the whole one in the list and its time in seconds."""

    dispatches: list[Dispatch] = field(default_factory=list)
    shares: list[tuple[int, float]] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        """Time of all of it."""
        return sum(seconds for _, seconds in self.shares)


class Timings:
    """Times of dispatches that were measured, by stage. Lists that do the same for other pictures begin with them."""

    def __init__(self, gpu: Gpu) -> None:
        self._gpu = gpu
        self._longest: dict[str, tuple[float, Work]] = {}

    @functools.cached_property
    def overhead(self) -> float:
        """Seconds of a submission without work, with the read that waits for it."""
        buffer = self._gpu.device.create_buffer(size=16, usage=_COPY)
        seconds = []
        for _ in range(_OVERHEAD_RUNS):
            start = time.perf_counter()
            self._gpu.device.queue.submit([self._gpu.device.create_command_encoder().finish()])
            self._gpu.device.queue.read_buffer(buffer)
            seconds.append(time.perf_counter() - start)
        return min(seconds)

    def note(self, dispatches: Sequence[Dispatch], seconds: Sequence[float], work: Work) -> None:
        """Keep the longest of the measured times of each stage."""
        longest: dict[str, float] = {}
        for dispatch, one in zip(dispatches, seconds, strict=True):
            longest[dispatch.stage] = max(one, longest.get(dispatch.stage, 0.0))
        self._longest |= {stage: (one, work) for stage, one in longest.items()}

    def bounds(self, dispatches: Sequence[Dispatch], work: Work) -> list[float]:
        """Return how long dispatches take at most, by what was measured of their stages; empty if any was not."""
        if any(dispatch.stage not in self._longest for dispatch in dispatches):
            return []
        known = (self._longest[dispatch.stage] for dispatch in dispatches)
        return [seconds * growth(before, work) for seconds, before in known]


def growth(before: Work, now: Work) -> float:
    """Return by how much a dispatch takes longer at most: in proportion to Gaussians, and to tiles."""
    return math.prod(max(1.0, b / max(a, 1)) for a, b in zip(before, now, strict=True))


class Submissions:
    """Runs one list of dispatches again and again.

    Parameters
    ----------
    sizes : wgpu.GPUBuffer
        Workgroups of the indirect ones.
    constants : Constants, optional
        What is sent to the card before a run.
    timings : Timings, optional
        Shared with other lists.
    work : callable, optional
        Returns the present numbers of Gaussians and of tiles, by which times are compared.

    Attributes
    ----------
    sizes : wgpu.GPUBuffer
    seconds : list of float
        Time of each dispatch, measured or at most; empty before the first run. Wall time: it includes what the driver
        adds, and every card can measure it.
    """

    def __init__(
        self,
        gpu: Gpu,
        dispatches: Sequence[Dispatch],
        sizes: Any,
        *,
        constants: Constants | None = None,
        timings: Timings | None = None,
        work: Callable[[], Work] = lambda: (1, 1),
    ) -> None:
        self._gpu, self.dispatches, self.sizes, self._constants = gpu, dispatches, sizes, constants
        self._timings, self._work = timings or Timings(gpu), work
        self._expected = work()
        self._runs = 0
        self._is_measured = False
        self._batches: list[Batch] = []
        self.seconds: list[float] = []

    def run(self, zeroed: Iterable[Any]) -> None:
        """Queue all dispatches after setting the buffers `zeroed` to zero."""
        run_together(self._gpu, [self], zeroed=zeroed)

    def next_batches(self) -> list[tuple[float, list[Dispatch]]]:
        """Return the dispatches of each submission of the next run with its forecast time, none if it measures them."""
        work = self._work()
        if not self.seconds:
            self._expect(self._timings.bounds(self.dispatches, work), work)
        elif (more := growth(self._expected, work)) > REMEASURED:
            self._expect([more * one for one in self.seconds], work)
        due = self._runs % MEASURE_INTERVAL == 0 and sum(self.seconds) > LIMIT_S / 10
        self._runs += 1
        # What does not fit into one submission by its forecast, which may be much too high, is measured.
        if due or not self.seconds or (not self._is_measured and sum(self.seconds) > FILL * LIMIT_S):
            return []
        return [(batch.seconds, batch.dispatches) for batch in self._batches]

    def _expect(self, seconds: list[float], work: Work) -> None:
        self.seconds, self._expected, self._is_measured = seconds, work, False
        self._batches = self.batches() if seconds else []

    def send_constants(self) -> None:
        """Send the constants that have changed: also those of new parts of a dispatch."""
        if self._constants is not None:
            self._constants.send()

    def measure(self) -> None:
        """Run the dispatches, and decide which are joined from now on.

        Without a forecast one by one, and from small parts on; otherwise in the submissions of the forecast.
        """
        if self.seconds:
            measured = [0.0] * len(self.dispatches)
            for batch in self._batches:
                factor = self._seconds_of(batch.dispatches) / batch.seconds
                for index, seconds in batch.shares:
                    measured[index] += factor * seconds
            self.seconds = measured
        else:
            self.seconds = [self._measure(dispatch) for dispatch in self.dispatches]
        self._expected, self._is_measured = self._work(), True
        self._timings.note(self.dispatches, self.seconds, self._expected)
        self._batches = self.batches()

    def batches(self) -> list[Batch]:
        """Return the submissions, by the forecast or measured times."""
        batches = [Batch()]
        for index, (one, seconds) in enumerate(zip(self.dispatches, self.seconds, strict=True)):
            parts = one.parts(_n_parts(seconds))
            for part in parts:
                share = seconds / len(parts)
                if batches[-1].dispatches and batches[-1].seconds + share > FILL * LIMIT_S:
                    batches.append(Batch())
                batches[-1].dispatches.append(part)
                batches[-1].shares.append((index, share))
        return batches

    def _measure(self, dispatch: Dispatch) -> float:
        """Run a dispatch alone, whose time nothing is known of, and return it in seconds."""
        if dispatch.part is None:
            return self._seconds_of([dispatch])
        total, at, n = 0.0, 0, FIRST_GROUPS
        while at < dispatch.n_groups:
            end = min(at + n, dispatch.n_groups)
            seconds = self._seconds_of([dispatch.part(at, end)])
            total, at = total + seconds, end
            n = min(4 * n, max(FIRST_GROUPS, int(n * FILL * LIMIT_S / seconds)))  # other tiles may take longer
        return total

    def _seconds_of(self, dispatches: Sequence[Dispatch]) -> float:
        wait_until_done(self._gpu, self.sizes)
        self.send_constants()
        start = time.perf_counter()
        encoder = self._gpu.device.create_command_encoder()
        encode(encoder, dispatches, self.sizes)
        self._gpu.device.queue.submit([encoder.finish()])
        wait_until_done(self._gpu, self.sizes)
        return max(time.perf_counter() - start - self._timings.overhead, _SHORTEST_S)


def wait_until_done(gpu: Gpu, buffer: Any) -> None:
    """Wait until all that is queued is done: a read of `buffer` comes last.

    wgpu 0.32 fails in `on_submitted_work_done_sync`. The driver frees a buffer only when the work that uses it is done.
    """
    gpu.device.queue.read_buffer(buffer, 0, 4)


def run_together(
    gpu: Gpu, runs: Iterable[Submissions], *, copies: Iterable[tuple[Any, Any]] = (), zeroed: Iterable[Any] = ()
) -> None:
    """Queue lists of dispatches one after the other, in as few submissions as the limit allows.

    Parameters
    ----------
    runs : iterable of Submissions
        What the processor writes to buffers in between is there from the first dispatch on.
    copies : iterable of (wgpu.GPUBuffer, wgpu.GPUBuffer)
        Buffers that are first copied to the start of others.
    zeroed : iterable of wgpu.GPUBuffer
        Buffers that are first set to zero.
    """
    device, filled = gpu.device, 0.0
    encoder = device.create_command_encoder()
    for source, to in copies:
        encoder.copy_buffer_to_buffer(source, 0, to, 0, source.size)
    for buffer in zeroed:
        encoder.clear_buffer(buffer)
    waiting: list[tuple[Sequence[Dispatch], Any]] = []

    def submit() -> None:
        if waiting:
            _encode_together(encoder, waiting)
        device.queue.submit([encoder.finish()])
        waiting.clear()

    for run in runs:
        batches = run.next_batches()
        run.send_constants()
        for seconds, together in batches:
            if filled and filled + seconds > FILL * LIMIT_S:
                submit()
                encoder, filled = device.create_command_encoder(), 0.0
            waiting.append((together, run.sizes))
            filled += seconds
        if not batches:
            submit()
            run.measure()
            encoder, filled = device.create_command_encoder(), 0.0
    submit()


def _n_parts(seconds: float) -> int:
    """Return into how many submissions a dispatch of so many seconds is split."""
    return math.ceil(seconds / (FILL * LIMIT_S))


def encode(
    encoder: Any, dispatches: Iterable[Dispatch], sizes: Any, time_stage: Callable[[str, Any], Any] | None = None
) -> None:
    """Add dispatches to the commands of `encoder`, in one compute pass.

    `time_stage` gives the descriptor of a compute pass for each stage, to measure it.
    """
    if time_stage is None:
        _encode_together(encoder, [(dispatches, sizes)])
        return
    for stage, together in itertools.groupby(dispatches, key=lambda dispatch: dispatch.stage):
        _encode_together(encoder, [(together, sizes)], timestamp_writes=time_stage(stage, encoder))


def _encode_together(encoder: Any, lists: Iterable[tuple[Iterable[Dispatch], Any]], **descriptor: Any) -> None:
    """Add lists of dispatches, each with its buffer of workgroups, to one compute pass."""
    compute = KernelPass(encoder, **descriptor)
    for dispatches, sizes in lists:
        for dispatch in dispatches:
            compute.add(dispatch, sizes)
    compute.end()
