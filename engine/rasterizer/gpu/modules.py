"""Compilation of WGSL without the checks that wgpu adds to every index and every loop.

Each kernel of this package keeps its indices inside of its buffers and ends its loops by itself, so the checks cost time
only. wgpu's Python interface does not offer this; the call is made through its private names, for the version that it was
tested with. Any other version compiles with the checks.
"""

from __future__ import annotations

import functools
from typing import Any

_VERSION = "0.32."


@functools.cache
def checks_can_be_left_out() -> bool:
    """Return whether this version of wgpu is known to compile without checks."""
    import wgpu

    try:
        from wgpu.backends.wgpu_native import _api

        names = ("ffi", "lib", "libf", "new_struct_p", "to_c_string_view", "GPUShaderModule")
        has_names = all(hasattr(_api, name) for name in names)
        return (
            wgpu.__version__.startswith(_VERSION)
            and has_names
            and hasattr(_api.lib, "wgpuDeviceCreateShaderModuleTrusted")
        )
    except (ImportError, AttributeError):
        return False


def create_module(device: Any, label: str, code: str) -> Any:
    """Return the shader module of `code`, without checks where `checks_can_be_left_out`."""
    if not checks_can_be_left_out():
        return device.create_shader_module(label=label, code=code)
    from wgpu.backends.wgpu_native import _api

    source = _api.new_struct_p("WGPUShaderSourceWGSL *", code=_api.to_c_string_view(code))
    source[0].chain.next = _api.ffi.NULL
    source[0].chain.sType = _api.lib.WGPUSType_ShaderSourceWGSL
    descriptor = _api.new_struct_p(
        "WGPUShaderModuleDescriptor *",
        nextInChain=_api.ffi.cast("WGPUChainedStruct *", source),
        label=_api.to_c_string_view(label),
    )
    no_checks = 0
    module = _api.libf.wgpuDeviceCreateShaderModuleTrusted(device._internal, descriptor, no_checks)
    return _api.GPUShaderModule(label, module, device)
