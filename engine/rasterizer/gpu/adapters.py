"""Choice of a graphics card, and a wgpu device on it."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

from ...errors import EnvironmentProblem
from .modules import checks_can_be_left_out

__all__ = ["Gpu", "adapter_count", "describe_adapters", "open_adapter"]

_ORDER = {"DiscreteGPU": 0, "IntegratedGPU": 1, "VirtualGPU": 2, "CPU": 3}
_BACKENDS = ("Vulkan", "Metal", "D3D12")


@dataclass(frozen=True)
class Gpu:
    """An opened graphics card.

    Attributes
    ----------
    device : wgpu.GPUDevice
    name, driver, backend : str
        As the driver reports them, such as ``NVIDIA H200``, ``580.159.04`` and ``Vulkan``.
    software : bool
        Whether the "card" is the processor (Mesa's llvmpipe).
    max_binding_bytes : int
        Largest storage buffer that a kernel can see.
    float64 : bool
        Whether kernels can compute in float64; the projection is less exact for needles without it.
    subgroups : bool
        Whether subgroups of exactly 32 invocations can be used.
    """

    device: Any
    name: str
    driver: str
    backend: str
    software: bool
    max_binding_bytes: int
    float64: bool
    subgroups: bool


def _adapters() -> list[Any]:
    """Return the usable adapters, cards first and the processor last."""
    try:
        import wgpu
    except (ImportError, OSError) as error:
        raise EnvironmentProblem(f"wgpu cannot be loaded ({error}); set up the engine again.") from error
    found = [a for a in wgpu.gpu.enumerate_adapters_sync() if a.info["backend_type"] in _BACKENDS]
    return sorted(found, key=lambda adapter: _ORDER.get(adapter.info["adapter_type"], 4))


def adapter_count(*, software: bool = False) -> int:
    """Return the number of graphics cards, with `software` also that of software renderers."""
    return sum(software or adapter.info["adapter_type"] != "CPU" for adapter in _adapters())


def describe_adapters() -> list[str]:
    """Return one line for each adapter: name, driver, interface, kind, largest buffer, and whether wgpu adds its checks."""
    checks = "" if checks_can_be_left_out() else ", kernels with the checks of wgpu"
    lines = []
    for adapter in _adapters():
        info, size = adapter.info, adapter.limits["max-storage-buffer-binding-size"]
        lines.append(
            f"{info['device']} ({info['backend_type']}, {info['description'] or 'driver unknown'}, "
            f"{info['adapter_type']}, buffers to {size / 2**20:.0f} MiB{checks})"
        )
    return lines


@functools.lru_cache(maxsize=4)
def open_adapter(*, software: bool = False, float64: bool = True, subgroups: bool = True) -> Gpu:
    """Open the best graphics card.

    Parameters
    ----------
    software : bool
        Also accept the processor as a card, for tests.
    float64, subgroups : bool
        Use these features where the card has them.

    Raises
    ------
    EnvironmentProblem
        If there is no graphics card, or its driver refuses.
    """
    usable = [a for a in _adapters() if software or a.info["adapter_type"] != "CPU"]
    if not usable:
        raise EnvironmentProblem("this computer has no graphics card with Vulkan, Metal or DirectX 12; use the CPU.")
    adapter = usable[0]
    info = dict(adapter.info)
    smallest = info.get("subgroup_min_size", info.get("stackgroup_min_size", 0))
    largest = info.get("subgroup_max_size", info.get("stackgroup_max_size", 0))
    wanted = {"timestamp-query": True, "shader-f64": float64, "subgroup": subgroups and smallest == largest == 32}
    features = [name for name, use in wanted.items() if use and name in adapter.features]
    limits = {
        name: adapter.limits[name]
        for name in ("max-storage-buffer-binding-size", "max-buffer-size", "max-compute-workgroup-storage-size")
    }
    limits["max-compute-workgroup-storage-size"] = min(limits["max-compute-workgroup-storage-size"], 32768)
    try:
        device = adapter.request_device_sync(required_features=features, required_limits=limits)
    except Exception as error:  # wgpu has no common class of its errors
        raise EnvironmentProblem(
            f"the driver of {info['device']} refuses to open it ({error}); use the CPU."
        ) from error
    return Gpu(
        device,
        str(info["device"]),
        str(info["description"]),
        str(info["backend_type"]),
        info["adapter_type"] == "CPU",
        int(limits["max-storage-buffer-binding-size"]),
        "shader-f64" in features,
        "subgroup" in features,
    )
