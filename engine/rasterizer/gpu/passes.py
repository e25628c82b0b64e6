"""Kernels added to a compute pass by few calls of Python.

wgpu's Python interface looks for an error after each call, and lets other threads run meanwhile: of the many short calls
of a step that takes several times as long as the call itself. An error in a pass is also reported by the next call of
that interface, the one that ends the commands. So the calls for each kernel go straight to the C functions, found by
private names, for the version of wgpu that this was tested with. Any other version is called by its interface.
"""

from __future__ import annotations

import ctypes
import functools
from typing import Any, NamedTuple

from .modules import checks_can_be_left_out


class _Functions(NamedTuple):
    """C functions, which are called without letting other threads run."""

    set_pipeline: Any
    set_bindings: Any
    dispatch: Any
    dispatch_indirect: Any


@functools.cache
def _functions() -> _Functions | None:
    """Return the C functions; None where this version of wgpu was not tested."""
    if not checks_can_be_left_out():
        return None
    from wgpu.backends.wgpu_native import _api

    def function(name: str, *arguments: Any) -> Any:
        at = _api.ffi.addressof(_api.lib, f"wgpuComputePassEncoder{name}")
        return ctypes.PYFUNCTYPE(None, ctypes.c_void_p, *arguments)(int(_api.ffi.cast("intptr_t", at)))

    u32, pointer = ctypes.c_uint32, ctypes.c_void_p
    return _Functions(
        function("SetPipeline", pointer),
        function("SetBindGroup", u32, pointer, ctypes.c_size_t, pointer),
        function("DispatchWorkgroups", u32, u32, u32),
        function("DispatchWorkgroupsIndirect", pointer, ctypes.c_uint64),
    )


def address_of(thing: Any) -> int:
    """Return the address of wgpu's C object behind a Python one, which has to live as long as it is used."""
    from wgpu.backends.wgpu_native import _api

    return int(_api.ffi.cast("intptr_t", thing._internal))


class KernelPass:
    """A compute pass of `encoder`; `descriptor` as of wgpu's `begin_compute_pass`."""

    def __init__(self, encoder: Any, **descriptor: Any) -> None:
        self._pass = encoder.begin_compute_pass(**descriptor)
        self._functions = _functions()
        self._address = address_of(self._pass) if self._functions else 0

    def add(self, kernel: Any, sizes: Any) -> None:
        """Add a `Dispatch`, whose workgroups may be in the buffer `sizes`."""
        if (direct := self._functions) is None:
            self._add_by_interface(kernel, sizes)
            return
        pipeline, bindings = kernel.addresses
        direct.set_pipeline(self._address, pipeline)
        direct.set_bindings(self._address, 0, bindings, 0, None)
        if kernel.indirect >= 0:
            direct.dispatch_indirect(self._address, address_of(sizes), 4 * kernel.indirect)
        else:
            direct.dispatch(self._address, *kernel.groups, 1)

    def _add_by_interface(self, kernel: Any, sizes: Any) -> None:
        self._pass.set_pipeline(kernel.pipeline)
        self._pass.set_bind_group(0, kernel.bindings)
        if kernel.indirect >= 0:
            self._pass.dispatch_workgroups_indirect(sizes, 4 * kernel.indirect)
        else:
            self._pass.dispatch_workgroups(*kernel.groups, 1)

    def end(self) -> None:
        """End the pass."""
        self._pass.end()
