"""Kernels are compiled without wgpu's checks for the version that this was tested with, and with them otherwise."""

from __future__ import annotations

import pytest

from engine.rasterizer.gpu import Gpu, modules

CODE = """
@group(0) @binding(0) var<storage, read_write> values: array<u32>;
@compute @workgroup_size(1) fn main() { values[0] = 7u; }
"""


@pytest.mark.parametrize("known", [True, False])
def test_a_kernel_computes_with_and_without_checks(
    known: bool, opened_gpu: Gpu, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert modules.checks_can_be_left_out()
    monkeypatch.setattr(modules, "checks_can_be_left_out", lambda: known)
    device = opened_gpu.device
    module = modules.create_module(device, "test", CODE)
    pipeline = device.create_compute_pipeline(layout="auto", compute={"module": module, "entry_point": "main"})
    buffer = device.create_buffer(size=16, usage=0x80 | 0x8 | 0x4)
    bindings = device.create_bind_group(
        layout=pipeline.get_bind_group_layout(0),
        entries=[{"binding": 0, "resource": {"buffer": buffer, "offset": 0, "size": 16}}],
    )
    encoder = device.create_command_encoder()
    compute = encoder.begin_compute_pass()
    compute.set_pipeline(pipeline)
    compute.set_bind_group(0, bindings)
    compute.dispatch_workgroups(1, 1, 1)
    compute.end()
    device.queue.submit([encoder.finish()])
    assert bytes(device.queue.read_buffer(buffer, 0, 4)) == b"\x07\0\0\0"


def test_another_version_of_wgpu_compiles_with_checks(monkeypatch: pytest.MonkeyPatch) -> None:
    modules.checks_can_be_left_out.cache_clear()
    monkeypatch.setattr("wgpu.__version__", "0.33.0")
    assert not modules.checks_can_be_left_out()
    modules.checks_can_be_left_out.cache_clear()
