"""Writes USD files by another Python that has OpenUSD: inside Blender, that of the engine, as Blender may have none."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from ..core.child_process import ChildFailure, run_in_child
from ..core.errors import DiskError, StartError
from ..scene import Gaussians
from .facts import NO_FACTS, FileFacts
from .ply import read_ply, write_ply
from .usd import write_usd

_MEMORY = 4 << 30
_MEMORY_PER_BYTE = 16
"""Address space of the child: Python and OpenUSD, and the Gaussians, their arrays in OpenUSD and copies."""
_SECONDS = 60.0
_BYTES_PER_SECOND = 2_000_000


def write_usd_elsewhere(python: Path, path: Path, gaussians: Gaussians, facts: FileFacts = NO_FACTS) -> None:
    """Write `gaussians` as USD by `python`, which has OpenUSD; see `write_usd` for `facts`.

    Raises
    ------
    DiskError
        When the other process fails; otherwise as `write_usd`.
    """
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "gaussians.ply"
        write_ply(source, gaussians)
        size = source.stat().st_size
        arguments = {
            "source": str(source),
            "target": str(path.absolute()),
            "name": facts.name,
            "metres_per_unit": facts.metres_per_unit,
            "extras": None if facts.extras is None else dict(facts.extras),
            "matrix": None if facts.matrix is None else facts.matrix.tolist(),
            "seen": None if facts.seen is None else facts.seen.tolist(),
        }
        try:
            run_in_child(
                "formats.usd_elsewhere:usd_from_ply",
                arguments,
                max_memory=_MEMORY + _MEMORY_PER_BYTE * size,
                max_seconds=_SECONDS + size / _BYTES_PER_SECOND,
                what=f"writing {path}",
                python=python,
            )
        except (ChildFailure, StartError) as failure:
            raise DiskError(f"{path} was not written: {failure} Export GLB, PLY or SPZ instead.") from failure


def usd_from_ply(
    source: str,
    target: str,
    name: str,
    metres_per_unit: float | None,
    extras: dict[str, Any] | None,
    matrix: list[list[float]] | None,
    seen: list[int] | None,
) -> None:
    """Write the Gaussians of the PLY file `source` as the USD file `target`; `write_usd_elsewhere` calls it."""
    facts = FileFacts(
        name,
        metres_per_unit=metres_per_unit,
        extras=extras,
        matrix=None if matrix is None else np.array(matrix),
        seen=None if seen is None else np.array(seen),
    )
    write_usd(Path(target), read_ply(Path(source)), facts)
