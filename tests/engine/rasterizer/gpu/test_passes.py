"""Kernels are added to a pass by wgpu's C functions for the version that this was tested with, and by its interface
otherwise; either way, errors are raised."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from engine.core.errors import EnvironmentProblem
from engine.rasterizer.gpu import Dispatch, Gpu, encode, passes, translate_card_errors
from engine.rasterizer.gpu.modules import create_module

CODE = """
@group(0) @binding(0) var<storage, read_write> counted: atomic<u32>;
@compute @workgroup_size(1) fn main() { atomicAdd(&counted, 1u); }
"""
_MOST_GROUPS = 65535
"""Largest number of workgroups along an axis of any card."""


@pytest.fixture(params=[True, False])
def is_direct(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[bool]:
    passes._functions.cache_clear()
    assert passes._functions() is not None
    passes._functions.cache_clear()
    monkeypatch.setattr(passes, "checks_can_be_left_out", lambda: request.param)
    yield request.param
    passes._functions.cache_clear()


def counter(gpu: Gpu) -> tuple[Any, Any, Any]:
    """Return a kernel whose workgroups are counted, its bindings, and the buffer of the number."""
    module = create_module(gpu.device, "test", CODE)
    pipeline = gpu.device.create_compute_pipeline(layout="auto", compute={"module": module, "entry_point": "main"})
    buffer = gpu.device.create_buffer(size=16, usage=0x80 | 0x8 | 0x4)
    entries = [{"binding": 0, "resource": {"buffer": buffer, "offset": 0, "size": 16}}]
    return pipeline, gpu.device.create_bind_group(layout=pipeline.get_bind_group_layout(0), entries=entries), buffer


def test_kernels_run_with_their_workgroups(is_direct: bool, opened_gpu: Gpu) -> None:
    pipeline, bindings, buffer = counter(opened_gpu)
    sizes = opened_gpu.device.create_buffer_with_data(data=np.array([9, 5, 1, 1], np.uint32), usage=0x100)
    kernels = [Dispatch("stage", pipeline, bindings, 3), Dispatch("stage", pipeline, bindings, 0, indirect=1)]
    encoder = opened_gpu.device.create_command_encoder()
    encode(encoder, kernels, sizes)
    opened_gpu.device.queue.submit([encoder.finish()])
    assert np.frombuffer(opened_gpu.device.queue.read_buffer(buffer, 0, 4), np.uint32)[0] == 3 + 5


def test_an_error_in_a_pass_is_raised(is_direct: bool, opened_gpu: Gpu) -> None:
    pipeline, bindings, _ = counter(opened_gpu)
    encoder = opened_gpu.device.create_command_encoder()
    compute = passes.KernelPass(encoder)
    with pytest.raises(EnvironmentProblem, match="group size"), translate_card_errors(opened_gpu, "use the CPU"):
        compute.add(_TooMany("stage", pipeline, bindings, 1), None)
        compute.end()
        encoder.finish()


class _TooMany(Dispatch):
    @property
    def groups(self) -> tuple[int, int]:
        return _MOST_GROUPS + 1, 1
