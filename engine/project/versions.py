"""The versions of ``project.json``: what each contains, and how an older one becomes the newest."""

from __future__ import annotations

from typing import Any

from ..core.files import FILE_RECORD, Migration, Schema, optional
from .provenance import RUN

__all__ = ["MIGRATIONS", "PROJECT_VERSION", "SCHEMAS"]

_STAGE_1 = {
    "key": str,
    "wall_seconds": float,
    "cpu_seconds": float,
    "peak_memory": optional((int, None)),
    "continued": optional(bool),
    "figures": dict,
}
_FORECAST = {
    "stage": str,
    **dict.fromkeys(("seconds", "low", "high", "memory", "memory_low", "memory_high"), float),
}
_PROJECT_1 = {
    "version": int,
    "stages": {str: _STAGE_1},
    "photo_folder": optional(str),
    "engine_version": optional(str),
    "objects_by_prompt": optional(({"key": str, "found": {str: [str]}}, None)),
    "work_plan": optional((dict, None)),
    "forecast": optional(({"stages": [_FORECAST]}, None)),
    "plan": optional(
        ({"held_out": [str], "mask_photos": [str], "features": bool, "left_out": [{"what": str, "why": str}]}, None)
    ),
}
_OUTPUTS = ({str: FILE_RECORD}, None)

SCHEMAS: tuple[Schema, ...] = (
    _PROJECT_1,
    {
        **_PROJECT_1,
        "stages": {str: {**_STAGE_1, "outputs": _OUTPUTS, "run": optional((RUN, None))}},
        "earlier_outputs": {str: {str: FILE_RECORD}},
        "objects_by_prompt": optional(
            (
                {
                    "key": str,
                    "found": {str: [(str, None)]},
                    "again": optional({str: [(str, None)]}),
                    "before": optional([str]),
                },
                None,
            )
        ),
    },
)

PROJECT_VERSION = len(SCHEMAS)


def _from_1_to_2(data: dict[str, Any]) -> dict[str, Any]:
    """Release 0.1.0 recorded no outputs: they are checked by reading them when a stage is next reused."""
    stages = {name: {**record, "outputs": None} for name, record in data["stages"].items()}
    return {**data, "stages": stages, "earlier_outputs": {}}


MIGRATIONS: tuple[Migration, ...] = (_from_1_to_2,)
