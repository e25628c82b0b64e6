"""Choice between the graphics card and the processor for a picture, and what the user is told about it."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Literal

from ..errors import EnvironmentProblem

__all__ = ["Device", "Wanted", "choose_device", "describe_cards", "fallback"]

Wanted = Literal["auto", "cpu", "gpu"]


@dataclass(frozen=True)
class Device:
    """What renders a picture.

    Attributes
    ----------
    backend : {"cpu", "gpu"}
        Argument of `engine.rasterizer.rasterize`.
    name : str
        ``cpu``, or the card with its interface.
    reason : str
        Why the card is not used, empty if it is or nobody asked for it.
    """

    backend: Literal["cpu", "gpu"]
    name: str
    reason: str = ""


def choose_device(wanted: Wanted) -> Device:
    """Return the device to render with.

    Parameters
    ----------
    wanted : {"auto", "cpu", "gpu"}
        ``auto``: the graphics card if there is one that passes its self-test, else the processor.

    Raises
    ------
    EnvironmentProblem
        If ``gpu`` is wanted, and there is no card or it fails the self-test.
    """
    if wanted == "cpu":
        return Device("cpu", "cpu")
    from .gpu import open_gpu

    try:
        gpu = open_gpu()
    except EnvironmentProblem as problem:
        if wanted == "gpu":
            raise
        return fallback(problem)
    return Device("gpu", f"{gpu.name} ({gpu.backend})")


def fallback(problem: EnvironmentProblem) -> Device:
    """Return the processor, with what is wrong with the card as the reason, without the advice to use the processor."""
    return Device("cpu", "cpu", str(problem).partition(";")[0].rstrip("."))


def describe_cards() -> tuple[bool, str]:
    """Return whether there is a usable graphics card, and what was found: cards, self-test, software that is not used."""
    from .gpu import describe_adapters, open_gpu

    try:
        cards, software = describe_adapters(), describe_adapters(software=True)
        unused = "".join(f"; {name} is software and not used" for name in software)
        if not cards:
            return False, f"none with Vulkan, Metal or DirectX 12{unused}"
        start = time.perf_counter()
        open_gpu()
    except EnvironmentProblem as problem:
        return False, str(problem).rstrip(".")
    unused = "".join(f"; {name} is another card and not used" for name in cards[1:]) + unused
    return True, f"{cards[0]}; self-test against the CPU passed in {time.perf_counter() - start:.1f} s{unused}"
