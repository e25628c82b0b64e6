"""No submission keeps a card busy for longer than the limit by the times measured, and splitting changes no bit."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from engine.rasterizer.gpu import Frame, FrameSize, Gpu, submissions
from engine.rasterizer.gpu.layout import pack_sh
from engine.rasterizer.gpu.submissions import FILL, LIMIT_S, Dispatch, Submissions, Timings
from engine.rasterizer.settings import RasterSettings

from ..scenes import camera, random_scene


def dispatch(n_groups: int, *, splits: bool = False) -> Dispatch:
    """Return a dispatch that no card runs."""
    whole = Dispatch("stage", None, None, n_groups)
    return replace(whole, part=lambda first, end: dispatch(end - first)) if splits else whole


def batches(seconds: list[float], dispatches: list[Dispatch], gpu: Gpu) -> list[list[Dispatch]]:
    planned = Submissions(gpu, dispatches, None)
    planned.seconds = seconds
    return [batch.dispatches for batch in planned.batches()]


def test_short_dispatches_are_one_submission(opened_gpu: Gpu) -> None:
    assert len(batches([1e-4] * 30, [dispatch(10) for _ in range(30)], opened_gpu)) == 1


def test_submissions_stay_below_the_limit_by_their_forecast(opened_gpu: Gpu) -> None:
    rng = np.random.default_rng(0)
    seconds = list(rng.uniform(0.0, FILL * LIMIT_S, 40))
    found = batches(seconds, [dispatch(i) for i in range(40)], opened_gpu)
    assert [one.n_groups for together in found for one in together] == list(range(40))
    assert max(sum(seconds[one.n_groups] for one in together) for together in found) <= FILL * LIMIT_S


def test_one_long_dispatch_is_split_where_its_kernel_allows_it(opened_gpu: Gpu) -> None:
    found = batches([0.01, 1.05, 0.01], [dispatch(5), dispatch(8160, splits=True), dispatch(5)], opened_gpu)
    parts = [one.n_groups for together in found for one in together][1:-1]
    assert len(parts) == 11 and sum(parts) == 8160 and max(parts) - min(parts) <= 10
    assert len(found) == 11 + 2  # each part nearly fills a submission
    (alone,) = batches([1.05], [dispatch(8160)], opened_gpu)
    assert len(alone) == 1


def images(gpu: Gpu, limit: float, n_runs: int, monkeypatch: pytest.MonkeyPatch) -> tuple[list[np.ndarray], list[int]]:
    """Return what the last of some runs wrote, and the number of submissions of each run."""
    monkeypatch.setattr(submissions, "LIMIT_S", limit)
    monkeypatch.setattr(submissions, "FIRST_GROUPS", 7)
    scene, view = random_scene(400), camera(150, 90)
    frame = Frame(gpu, FrameSize(400, 16, 0, 150, 90, 20_000))
    for name, value in scene.tensors().items():
        frame.write(name, pack_sh(value.numpy()) if name == "sh" else value.numpy())
    frame.set_view(view, RasterSettings(), 3)
    frame.write("gradient", np.random.default_rng(0).normal(size=(90, 150, 4)).astype(np.float32))
    queue, counted = gpu.device.queue, []
    submit = queue.submit
    for _ in range(n_runs):
        counted.append(0)

        def count(buffers: Any) -> None:
            counted[-1] += 1
            submit(buffers)

        monkeypatch.setattr(queue, "submit", count)
        frame.forward()
        frame.backward()
        monkeypatch.setattr(queue, "submit", submit)
    shapes = {"image": (90, 150, 3), "transmittance": (90, 150), "gradients": (400, 12)}
    return [frame.read(name, shape) for name, shape in shapes.items()], counted


def test_split_submissions_give_the_bits_of_one(opened_gpu: Gpu, monkeypatch: pytest.MonkeyPatch) -> None:
    first, _ = images(opened_gpu, 1e6, 1, monkeypatch)
    one, counted = images(opened_gpu, 1e6, 2, monkeypatch)
    split, counted_split = images(opened_gpu, 1e-4, 2, monkeypatch)
    assert counted[1] == 2  # forward and backward
    assert counted_split[1] > 20
    for measured, whole, parts in zip(first, one, split, strict=True):
        assert np.array_equal(measured, whole) and np.array_equal(parts, whole)


def test_grown_work_is_measured_again_only_if_it_may_take_long(opened_gpu: Gpu) -> None:
    work = [10, 4]
    run = Submissions(opened_gpu, [dispatch(10), dispatch(20)], None, work=lambda: (work[0], work[1]))
    run.seconds = [1e-4, 2e-4]
    work[0] = 20
    assert run.next_batches()
    assert run.seconds == [2e-4, 4e-4]
    work[:] = 200, 400
    assert not run.next_batches()
    assert run.seconds == [0.2, 0.4]


def test_lists_of_other_pictures_begin_with_what_was_measured(opened_gpu: Gpu) -> None:
    timings = Timings(opened_gpu)
    timings.note([dispatch(10), dispatch(20)], [1e-4, 2e-4], (10, 4))
    small, large, huge = (
        Submissions(opened_gpu, [dispatch(5)], None, timings=timings, work=lambda n=n: (10, n)) for n in (2, 8, 4000)
    )
    assert small.next_batches()
    assert small.seconds == [2e-4]  # the longest of the stage
    assert large.next_batches()
    assert large.seconds == [4e-4]
    assert not huge.next_batches()  # 0.2 s do not fit into one submission: it is measured
    other = Submissions(opened_gpu, [replace(dispatch(5), stage="another")], None, timings=timings)
    assert not other.next_batches()
