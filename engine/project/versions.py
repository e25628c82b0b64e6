"""The schema of ``project.json``, and the number of its format."""

from __future__ import annotations

from ..core.files import FILE_RECORD, Schema, optional
from .provenance import RUN

PROJECT_VERSION = 1
"""Increased by a release whose projects earlier ones cannot read; see `engine.core.files.read_versioned`."""

_OUTPUTS = {str: FILE_RECORD}
_STAGE = {
    "key": str,
    "wall_seconds": float,
    "cpu_seconds": float,
    "peak_memory": optional((int, None)),
    "continued": optional(bool),
    "figures": dict,
    "outputs": _OUTPUTS,
    "run": optional((RUN, None)),
}
_FORECAST = {
    "stage": str,
    **dict.fromkeys(("seconds", "low", "high", "memory", "memory_low", "memory_high"), float),
}
_FOUND = {str: [(str, None)]}

PROJECT_SCHEMA: Schema = {
    "version": int,
    "stages": {str: _STAGE},
    "earlier_outputs": {str: _OUTPUTS},
    "photo_folder": optional(str),
    "learns_words": optional(bool),
    "engine_version": optional(str),
    "objects_by_prompt": optional(
        ({"key": str, "found": _FOUND, "again": optional(_FOUND), "before": optional([str])}, None)
    ),
    "work_plan": optional((dict, None)),
    "forecast": optional(({"stages": [_FORECAST]}, None)),
    "plan": optional(
        ({"held_out": [str], "mask_photos": [str], "features": bool, "left_out": [{"what": str, "why": str}]}, None)
    ),
}
