"""How users of gsply and plyfile write and read the arrays of Gaussians."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from engine.scene import Gaussians

_REST = tuple(f"f_rest_{i}" for i in range(45))
_COLOR = ("f_dc_0", "f_dc_1", "f_dc_2")
_SCALE = ("scale_0", "scale_1", "scale_2")
_ROTATION = ("rot_0", "rot_1", "rot_2", "rot_3")
_NAMES = ("x", "y", "z", "nx", "ny", "nz", *_COLOR, *_REST, "opacity", *_SCALE, *_ROTATION)
_ROW = np.dtype([(name, "<f4") for name in _NAMES])


def gsply_writes(file: Path, gaussians: Gaussians) -> None:
    """Write with gsply."""
    import gsply

    arrays = (gaussians.means, gaussians.log_scales, gaussians.quats, gaussians.opacity_logits)
    gsply.plywrite(str(file), gsply.GSData.from_arrays(*arrays, gaussians.sh[:, 0], gaussians.sh[:, 1:]))


def gsply_reads(file: Path) -> Any:
    """Read with gsply, whose arrays are views of its table until they are used."""
    import gsply

    data = gsply.plyread(str(file))
    return [
        np.ascontiguousarray(getattr(data, name)) for name in ("means", "scales", "quats", "opacities", "sh0", "shN")
    ]


def plyfile_writes(file: Path, gaussians: Gaussians) -> None:
    """Write with plyfile, rows of which are filled column by column, as its documentation does."""
    rows = np.empty(len(gaussians), _ROW)
    for axis, name in enumerate("xyz"):
        rows[name], rows[f"n{name}"] = gaussians.means[:, axis], 0
    for names, values in (
        (_COLOR, gaussians.sh[:, 0]),
        (_REST, gaussians.sh[:, 1:].transpose(0, 2, 1).reshape(len(gaussians), -1)),
        (("opacity",), gaussians.opacity_logits[:, None]),
        (_SCALE, gaussians.log_scales),
        (_ROTATION, gaussians.quats),
    ):
        for column, name in enumerate(names):
            rows[name] = values[:, column]
    _plyfile_writes_rows(file, rows)


def plyfile_writes_table(file: Path, gaussians: Gaussians) -> None:
    """Write with plyfile, rows of which are a table that NumPy joins: the fastest way that was found."""
    rest = gaussians.sh[:, 1:].transpose(0, 2, 1).reshape(len(gaussians), -1)
    parts = (gaussians.means, np.zeros_like(gaussians.means), gaussians.sh[:, 0], rest)
    more = (gaussians.opacity_logits[:, None], gaussians.log_scales, gaussians.quats)
    _plyfile_writes_rows(file, np.concatenate([*parts, *more], axis=1).view(_ROW)[:, 0])


def _plyfile_writes_rows(file: Path, rows: Any) -> None:
    from plyfile import PlyData, PlyElement

    PlyData([PlyElement.describe(rows, "vertex")]).write(str(file))


def plyfile_reads(file: Path) -> Any:
    """Read with plyfile into the arrays of Gaussians."""
    from plyfile import PlyData

    vertex = PlyData.read(str(file))["vertex"]

    def columns(names: tuple[str, ...]) -> Any:
        return np.stack([vertex[name] for name in names], axis=1)

    rest = columns(_REST).reshape(-1, 3, 15).transpose(0, 2, 1)
    sh = np.concatenate([columns(_COLOR)[:, None], rest], axis=1)
    return Gaussians(columns(("x", "y", "z")), columns(_SCALE), columns(_ROTATION), np.array(vertex["opacity"]), sh)
