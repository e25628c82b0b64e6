"""What a plan trains on: values only, chosen by `device_choice`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, NamedTuple

__all__ = ["ON_PROCESSOR", "DeviceChoice", "TrainingDevice"]


@dataclass(frozen=True)
class TrainingDevice:
    """What the plan trains on.

    Attributes
    ----------
    backend : {"cpu", "gpu"}
    name : str
        ``cpu``, or the card with its interface.
    reason : str
        Why it is not the card; empty if it is, or the user asked for the processor.
    memory : int or None
        Bytes of the card's own memory, where they are known.
    shares_memory : bool
        Whether the card uses the computer's memory.
    n_bytes : int
        Expected bytes on the card.
    limited : bool
        Whether the card holds fewer Gaussians than the preset has on a card.
    kept : bool
        Whether the sizes are those of an earlier run, and other ones would be chosen now.
    """

    backend: Literal["cpu", "gpu"] = "cpu"
    name: str = "cpu"
    reason: str = ""
    memory: int | None = None
    shares_memory: bool = False
    n_bytes: int = 0
    limited: bool = False
    kept: bool = False


class DeviceChoice(NamedTuple):
    """The device of a plan, and the sizes of its preset: settings in place of its own by name, empty for none."""

    device: TrainingDevice = TrainingDevice()
    sizes: Mapping[str, int] = MappingProxyType({})


ON_PROCESSOR = DeviceChoice()
"""The preset with its own sizes on the processor."""
