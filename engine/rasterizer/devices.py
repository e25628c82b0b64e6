"""Choice between the graphics card and the processor, and what the user is told."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal, TypeVar

from ..core.child_process import ChildFailure, run_in_child
from ..core.errors import EnvironmentProblem
from ..core.parts import part
from ..core.system import card_memory
from .settings import DeviceName

_Result = TypeVar("_Result")

_CARD_SECONDS = 60.0
"""For the self-test of the graphics card, which takes one or two."""
_CARD_BYTES = 1 << 46
"""Address space for it: drivers reserve much more than they use."""
_NO_CARD_SENTENCE = "this computer has no graphics card with Vulkan, Metal or DirectX 12"


@dataclass(frozen=True)
class Device:
    """What renders or trains, why, and what was found when a card was looked for.

    Attributes
    ----------
    backend : {"cpu", "gpu"}
        Argument of `engine.rasterizer.rasterize`.
    name : str
        ``cpu``, or the card with its interface, such as ``NVIDIA H100 80GB HBM3 (Vulkan)``.
    reason : str
        Why the card is not used, a clause; empty if it is or nobody asked for it.
    required : bool
        Whether the user asked for the card, so that the processor does not replace it when it fails.
    found : str
        Cards, self-test, and software that is not used, for `doctor`.
    max_buffer_bytes : int
        Largest buffer that a kernel of the card can see; 0 where no card was looked for.
    memory : int or None
        Bytes of the card's own memory; None where that is not known, or the card uses the computer's memory.
    shares_memory : bool
        Whether its buffers are in the computer's memory.
    planned : bool
        Whether it is that of a plan: sizes were chosen for it, and it stays as it is.
    n_bytes : int
        Bytes that the plan expects on the card.
    limited : bool
        Whether the card holds fewer Gaussians than the preset has on a card.
    kept : bool
        Whether the sizes are those of an earlier run, and other ones would be chosen now.
    """

    backend: Literal["cpu", "gpu"] = "cpu"
    name: str = "cpu"
    reason: str = ""
    required: bool = False
    found: str = field(default="", compare=False)
    max_buffer_bytes: int = 0
    memory: int | None = None
    shares_memory: bool = False
    planned: bool = False
    n_bytes: int = 0
    limited: bool = False
    kept: bool = False


PROCESSOR = Device()


def choose_device(wanted: DeviceName) -> Device:
    """Return the device to render and train on. It survives a driver that crashes or hangs.

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
        return PROCESSOR
    device = look_for_card()
    if wanted == "auto":
        return device
    if device.backend == "cpu":
        raise EnvironmentProblem(f"{device.reason}; use --device cpu.")
    return replace(device, required=True)


def run_on(device: Device, compute: Callable[[Device], _Result]) -> tuple[_Result, Device]:
    """Return what `compute` returns on a device, or on the processor if the card fails, and the device that did it.

    Raises
    ------
    EnvironmentProblem
        If it fails on the processor, or on the card that the user asked for.
    """
    try:
        return compute(device), device
    except EnvironmentProblem as problem:
        if device.backend == "cpu" or device.required:
            raise
        device = fallback(problem)
        return compute(device), device


def fallback(problem: EnvironmentProblem) -> Device:
    """Return the processor, with what is wrong with the card as the reason, without the advice to use the processor.

    The next run tests the card again.
    """
    from .gpu import forget_passes

    forget_passes()
    return Device("cpu", "cpu", _clause(problem))


def device_words(name: str, reason: str = "") -> str:
    """Return the name of a device and why it is not the card, as the end of a sentence without its full stop."""
    shown = "the processor" if name == "cpu" else name
    return f"{shown}, because {reason}" if reason else shown


def training_stopped(device: Device, problem: EnvironmentProblem) -> EnvironmentProblem:
    """Return the error of a training that `problem` ended: what is wrong with the card says how to continue."""
    card, message = device.name.rpartition(" (")[0], str(problem)
    if device.backend == "cpu" or card not in message or "--device cpu" in message:
        return problem
    return EnvironmentProblem(
        f"Training on {device.name} stopped, because {_clause(problem)}. Run again to continue from the last checkpoint, "
        "or with --device cpu to continue on the processor; a smaller preset or fewer photos need less of the card's memory."
    )


def look_for_card(*, always_test: bool = False) -> Device:
    """Return the card, or the processor with the reason, in a process of its own: a driver may crash or hang.

    A card that passed with the same driver and code in an earlier run is not tested again, unless `always_test`.
    """
    try:
        with part("self-test of the card"):
            answer = run_in_child(
                "rasterizer.devices:describe_cards", {"always_test": always_test}, max_memory=_CARD_BYTES,
                max_seconds=_CARD_SECONDS, what="testing the graphics card",
            )  # fmt: skip
    except ChildFailure as failure:
        reason = str(failure).rstrip(".")
        return Device(reason=f"{reason[:1].lower()}{reason[1:]}", found=f"{reason}; update its driver")
    device = Device(**answer)
    if device.backend == "gpu":
        from .gpu import passed_elsewhere

        passed_elsewhere(device.name)
    return device


def describe_cards(*, always_test: bool = False) -> dict[str, Any]:
    """Return the values of a `Device` as JSON values: the card, or the processor with the reason. See `look_for_card`."""
    from .gpu import describe_adapters, forget_passes, keep_pass, passed_before

    try:
        cards, software = describe_adapters(), describe_adapters(software=True)
        unused = "".join(f"; {name} is software and not used" for name in software)
        if not cards:
            return asdict(Device(reason=_NO_CARD_SENTENCE, found=f"none with Vulkan, Metal or DirectX 12{unused}"))
        if always_test:
            forget_passes()
        if passed_before(cards[0]):
            from .gpu import open_adapter

            gpu, tested = open_adapter(), "its self-test passed before"
        else:
            # Only now, because it imports torch, which takes longer than to look for cards.
            from .gpu import open_gpu

            start = time.perf_counter()
            gpu = open_gpu()
            tested = f"self-test against the CPU passed in {time.perf_counter() - start:.1f} s"
            keep_pass(cards[0])
    except EnvironmentProblem as problem:
        return asdict(Device(reason=_clause(problem), found=str(problem).rstrip(".")))
    memory = None if gpu.shares_memory else card_memory(gpu.name)
    unused = "".join(f"; {name} is another card and not used" for name in cards[1:]) + unused
    size = "" if memory is None else f", {memory / 2**30:.0f} GiB memory"
    found = f"{cards[0]}{size}; {tested}{unused}"
    device = Device(
        "gpu", f"{gpu.name} ({gpu.backend})", found=found, max_buffer_bytes=gpu.max_binding_bytes, memory=memory,
        shares_memory=gpu.shares_memory,
    )  # fmt: skip
    return asdict(device)


def _clause(problem: EnvironmentProblem) -> str:
    return str(problem).partition(";")[0].rstrip(".")
