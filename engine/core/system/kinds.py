"""Which system this is, and the systems that all packages of the engine have files for."""

from __future__ import annotations

import ctypes
import platform
import sys
from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class System:
    """An operating system with a processor that the engine runs on.

    Attributes
    ----------
    name : str
        As in ``make offline-bundle SYSTEM=...``.
    title : str
        As users know it.
    packages : str
        As `package_system` returns it there.
    blender : str
        Blender's name for it, in the manifest of the extension.
    tags : tuple of str
        Platform tags of the wheels that run there, as pip's ``--platform`` takes them.
    markers : mapping of str to str
        Values of the environment markers that its packages depend on (PEP 508).
    """

    name: str
    title: str
    packages: str
    blender: str
    tags: tuple[str, ...]
    markers: Mapping[str, str]


_MANYLINUX = tuple(f"manylinux_2_{minor}_x86_64" for minor in range(28, 16, -1))
_LINUX_TAGS = (*_MANYLINUX, "manylinux2014_x86_64", "manylinux2010_x86_64", "manylinux1_x86_64")

SYSTEMS: Mapping[str, System] = {
    system.name: system
    for system in (
        System(
            "windows", "Windows 10 or newer on x64 processors", "win32-amd64", "windows-x64", ("win_amd64",),
            {"sys_platform": "win32", "os_name": "nt", "platform_system": "Windows", "platform_machine": "AMD64"},
        ),
        System(
            "macos", "macOS 14 or newer on Apple chips", "darwin-arm64", "macos-arm64", ("macosx_14_0_arm64",),
            {"sys_platform": "darwin", "os_name": "posix", "platform_system": "Darwin", "platform_machine": "arm64"},
        ),
        System(
            "linux", "Linux with glibc 2.28 or newer on x64 processors", "linux-x86_64", "linux-x64", _LINUX_TAGS,
            {"sys_platform": "linux", "os_name": "posix", "platform_system": "Linux", "platform_machine": "x86_64"},
        ),
    )
}  # fmt: skip
_MIN_MACOS = 14


def package_system() -> str:
    """Return operating system and processor, for example ``linux-x86_64``."""
    return f"{sys.platform}-{platform.machine().lower()}"


def describe_system() -> str:
    """Return operating system and processor as text, for example ``Linux x86_64``."""
    return f"{platform.system()} {platform.machine()}"


def this_system() -> System | None:
    """Return the entry of `SYSTEMS` for this computer, None where the engine's packages have no files for it."""
    # A Python for Intel processors on an Apple chip, or for x64 on Windows for ARM, states its own processor.
    found = next((system for system in SYSTEMS.values() if system.packages == package_system()), None)
    if found is not None and sys.platform == "darwin" and _macos_version() < _MIN_MACOS:
        return None
    return found


def unsupported() -> str:
    """Return a sentence that says why the engine cannot be set up on this computer, empty where it can."""
    if this_system() is not None:
        return ""
    version = f" {platform.mac_ver()[0]}" if sys.platform == "darwin" else ""
    runs_on = ", ".join(system.title for system in SYSTEMS.values())
    return (
        f"The engine cannot run on this computer ({describe_system()}{version}): PyTorch, pycolmap or ONNX Runtime "
        f"have no packages for it. It runs on {runs_on}. Projects can be made there, or on the web page of such a "
        "computer, and opened here."
    )


def missing_runtime() -> str:
    """Return a sentence about a library of the system that the engine's packages need, empty where it is there.

    Torch and pycolmap need Microsoft's C++ runtime, which Windows itself does not bring.
    """
    if sys.platform == "win32":
        for name in ("vcruntime140", "vcruntime140_1", "msvcp140"):
            try:
                ctypes.WinDLL(name)
            except OSError:
                return (
                    f"Windows lacks {name}.dll, which PyTorch needs. Install Microsoft's Visual C++ Redistributable "
                    "for x64 from https://aka.ms/vs/17/release/vc_redist.x64.exe, then set up the engine again."
                )
    return ""


def _macos_version() -> int:
    first = platform.mac_ver()[0].partition(".")[0]
    return int(first) if first.isdecimal() else _MIN_MACOS
