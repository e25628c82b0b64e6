"""Choice of a graphics card, and a wgpu device on it."""

from __future__ import annotations

import contextlib
import functools
import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from ...core.errors import EnvironmentProblem
from .modules import checks_can_be_left_out

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
    shares_memory : bool
        Whether buffers are in the computer's own memory (integrated cards and software).
    """

    device: Any
    name: str
    driver: str
    backend: str
    software: bool
    max_binding_bytes: int
    float64: bool
    shares_memory: bool


@functools.lru_cache(maxsize=1)
def _wgpu() -> Any:
    """Return the module wgpu, which looks for cards with the interfaces of `_BACKENDS` only.

    Looking with OpenGL too takes another half second. Mesa's layer that sorts cards writes to standard error where there
    is no display, and is not needed: `open_adapter` sorts them.
    """
    os.environ.setdefault("NODEVICE_SELECT", "1")
    try:
        import wgpu
        from wgpu.backends.wgpu_native.extras import set_instance_extras
    except ImportError as error:
        raise EnvironmentProblem(
            f"this Python has no wgpu for graphics cards ({error}); set up the engine again, in Blender or with "
            "`make setup`, or use the CPU."
        ) from error
    except (OSError, RuntimeError) as error:  # its library does not fit this computer
        raise EnvironmentProblem(f"wgpu cannot be loaded ({error}); set up the engine again.") from error
    with contextlib.suppress(RuntimeError):  # another module of this process has looked for cards before
        set_instance_extras(backends=["Vulkan", "Metal", "DX12"])
    return wgpu


def _adapters() -> list[Any]:
    """Return the usable adapters, cards first and the processor last."""
    wgpu = _wgpu()
    found = [a for a in wgpu.gpu.enumerate_adapters_sync() if a.info["backend_type"] in _BACKENDS]
    return sorted(found, key=lambda adapter: _ORDER.get(adapter.info["adapter_type"], 4))


def describe_adapters(*, software: bool = False) -> list[str]:
    """Return one line for each graphics card, or for each `software` adapter: name, interface, driver, kind, limits.

    A card that is reached by two interfaces is described with the one that `open_adapter` takes.
    """
    found: dict[str, str] = {}
    for adapter in _adapters():
        if (adapter.info["adapter_type"] == "CPU") == software:
            found.setdefault(adapter.info["device"], _describe(adapter))
    return list(found.values())


def _describe(adapter: Any) -> str:
    info, limits = adapter.info, adapter.limits
    checks = "" if checks_can_be_left_out() else ", kernels with the checks of wgpu"
    float64 = "float64" if "shader-f64" in adapter.features else "no float64"
    return (
        f"{info['device']} ({info['backend_type']}, driver {info['description'] or 'unknown'}, {info['adapter_type']}, "
        f"buffers to {limits['max-storage-buffer-binding-size'] / 2**20:.0f} MiB, workgroup memory "
        f"{limits['max-compute-workgroup-storage-size'] / 2**10:.0f} KiB, {float64}{checks})"
    )


@functools.lru_cache(maxsize=4)
def open_adapter(*, software: bool = False, float64: bool = True) -> Gpu:
    """Open the best graphics card.

    Parameters
    ----------
    software : bool
        Also accept the processor as a card, for tests.
    float64 : bool
        Use it where the card has it.

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
    wanted = {"timestamp-query": True, "shader-f64": float64}
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
        info["adapter_type"] != "DiscreteGPU",
    )


@contextlib.contextmanager
def translate_card_errors(gpu: Gpu, advice: str) -> Iterator[None]:
    """Translate errors of the driver, such as full memory or a lost card, into one sentence that ends with `advice`.

    Raises
    ------
    EnvironmentProblem
    """
    try:
        yield
    except _wgpu().GPUOutOfMemoryError as error:
        raise EnvironmentProblem(f"the memory of the graphics card {gpu.name} is full; {advice}.") from error
    except (_wgpu().GPUError, _wgpu().GPUPipelineError) as error:
        reason = " ".join(str(error).split())
        raise EnvironmentProblem(f"the graphics card {gpu.name} stopped working ({reason}); {advice}.") from error
