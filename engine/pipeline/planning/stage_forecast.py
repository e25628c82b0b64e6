"""Forecast of a stage, and its wall seconds from CPU seconds, also beside the work that is done at the same time."""

from __future__ import annotations

from dataclasses import dataclass, replace

_SERIAL_SHARE = {
    "photos": 0.1, "cameras": 0.2, "masks": 0.25, "training": 0.16, "objects": 0.6, "report": 0.9
}  # fmt: skip  # chosen on museum_room, sakharov_statue32
"""Share of each stage's work that cannot be divided among cores."""
_MAX_CORES = {"masks": 2}
"""Largest number of cores that a stage can use. SAM encodes a photo on one and decodes clicks on the other."""


@dataclass(frozen=True)
class StageForecast:
    """Expected time and memory of a stage.

    Attributes
    ----------
    stage : str
    seconds, low, high : float
        Wall seconds; 8 of 10 runs are expected between `low` and `high`.
    cpu_seconds : float
    model_cpu_seconds : float
        Result of the formula before corrections from earlier runs. Outcomes are compared with it.
    memory, memory_low, memory_high : int
        Peak memory of the process in bytes; 8 of 10 runs are expected between the last two.
    model_memory : int
        Peak memory from the formula, before corrections.
    wall_share : float
        Wall seconds per CPU second before corrections, beside the work that is done at the same time.
    """

    stage: str
    seconds: float
    low: float
    high: float
    cpu_seconds: float
    model_cpu_seconds: float
    memory: int
    memory_low: int
    memory_high: int
    model_memory: int
    wall_share: float = 1.0


def wall_share(stage: str, cores: int) -> float:
    """Return the wall seconds per CPU second of a stage on `cores` idle cores, after Amdahl's law.

    A stage on a graphics card, named as by `outcome_name`, takes as long as its formula says on any number of cores.
    """
    if stage not in _SERIAL_SHARE:
        return 1.0
    cores = min(cores, _MAX_CORES.get(stage, cores))
    return _SERIAL_SHARE[stage] + (1.0 - _SERIAL_SHARE[stage]) / cores


def with_work_beside(
    stages: tuple[StageForecast, ...], cores: int, n_masks: int, picture_seconds: float
) -> tuple[StageForecast, ...]:
    """Return the stages where masks and a first picture are made while the cameras are estimated.

    Parameters
    ----------
    stages : tuple of StageForecast
        Each as if it had all cores.
    n_masks : int
        Processes that make masks.
    picture_seconds : float
        CPU seconds of the first picture, 0 without one.

    Notes
    -----
    While the cameras use all cores, each process gets a share. During the serial share of the cameras' work the others
    have all cores but one. What masks are left then is done after the cameras.
    """
    named = {stage.stage: stage for stage in stages}
    cameras, masks = named["cameras"], named.get("masks")
    mask_seconds = masks.cpu_seconds if masks and n_masks else 0.0
    serial = _SERIAL_SHARE["cameras"] * cameras.cpu_seconds
    divided, beside = cameras.cpu_seconds - serial, mask_seconds + picture_seconds
    busy = n_masks / wall_share("masks", cores) + (picture_seconds > 0.0)
    rate = cores * busy / (cores + busy)
    seconds = min((divided + beside) / cores, divided / (cores - rate))
    left = max(0.0, beside - rate * seconds - min(cores - 1, busy) * serial)
    kept = {"cameras": (seconds + serial) / (cameras.cpu_seconds * cameras.wall_share)}
    if mask_seconds:
        kept["masks"] = min(1.0, left / mask_seconds)
    return tuple(
        replace(
            stage,
            seconds=stage.seconds * (part := kept.get(stage.stage, 1.0)),
            low=stage.low * part,
            high=stage.high * part,
            wall_share=stage.wall_share * part,
        )
        for stage in stages
    )
