"""Reader of Gaussians in USD files: in a child process, because OpenUSD ends its process on some damaged files.

The child writes what it found as a PLY file, which our own reader checks. The engine alone can start the child: inside
Blender, the program of this process is Blender.
"""

from __future__ import annotations

import os
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.child_process import ChildFailure, run_in_child
from ..core.errors import FormatError
from ..scene import Gaussians
from .axes import file_from_z_up
from .bounds import opened_with_size, require_memory, usable_rows
from .ply import read_ply, write_ply
from .render_mode import RENDER_MODE, RENDER_MODE_KEY
from .transform import logits_of
from .usd import PRIM_TYPE, require_openusd

_MEMORY = 1 << 30
_MEMORY_PER_BYTE = 8
"""Address space of the child: OpenUSD itself, and the file, its arrays and their copies."""
_SECONDS = 60.0
_BYTES_PER_SECOND = 5_000_000


def read_usd(path: Path) -> Gaussians:
    """Return the Gaussians of the only prim of the type `PRIM_TYPE` in a USD file, in the engine's world (Z up).

    Transforms of the prim and of its parents are applied. Lengths stay in the unit of the file.

    Raises
    ------
    EnvironmentProblem
        When OpenUSD is missing, or does not know the type of prim.
    FormatError
        When the file cannot be read, has no such prim or several, takes parts from other files, or has values that are
        missing, not finite or too large.
    """
    with opened_with_size(path) as (_, size):
        require_memory(path, 3 * size)
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "gaussians.ply"
        try:
            run_in_child(
                "formats.usd_reading:convert_usd",
                {"source": str(path), "target": str(target)},
                max_memory=_MEMORY + _MEMORY_PER_BYTE * size,
                max_seconds=_SECONDS + size / _BYTES_PER_SECOND,
                what=f"reading {path}",
            )
        except ChildFailure as failure:
            raise FormatError(f"{path} is a damaged USD file. {failure} Export it again.") from failure
        return read_ply(target)


def convert_usd(source: str, target: str) -> None:
    """Write the Gaussians of the USD file `source` as the PLY file `target`; `read_usd` calls it in the child."""
    # On several threads, one of 70 readings of the same file crashed on a busy computer; none of 560 did on one.
    os.environ["PXR_WORK_THREAD_LIMIT"] = "1"
    require_openusd("or choose a PLY, GLB or SPZ file")
    from pxr import Sdf, Tf, Usd, UsdGeom

    try:
        layer = Sdf.Layer.OpenAsAnonymous(source)
        if layer.GetCompositionAssetDependencies():
            raise FormatError(f"{source} takes parts from other files. Export it as one file.")
        stage = Usd.Stage.Open(layer, load=Usd.Stage.LoadNone)
        prims = [prim for prim in stage.Traverse() if prim.GetTypeName() == PRIM_TYPE]
        if len(prims) != 1:
            raise FormatError(
                f"{source} has {len(prims)} prims of the type {PRIM_TYPE}; one is expected. Choose another."
            )
        gaussians = _gaussians(prims[0])
        is_mip = layer.customLayerData.get(RENDER_MODE_KEY) == RENDER_MODE[True]
        gaussians = replace(gaussians, antialiased=is_mip)
        matrix = np.array(UsdGeom.XformCache().GetLocalToWorldTransform(prims[0])).T
        is_y_up = UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y
    except (Tf.ErrorException, RuntimeError, TypeError, ValueError) as error:
        raise FormatError(
            f"{source} is not a USD file with Gaussians that can be read ({_reason(error)}). Export it again."
        ) from error
    if not usable_rows(gaussians).all():
        raise FormatError(f"{source} has Gaussians with values that are not finite or too large. Export it again.")
    write_ply(Path(target), gaussians, matrix=file_from_z_up("y").T @ matrix if is_y_up else matrix)


def _reason(error: Exception) -> str:
    try:
        lines = str(error).strip().splitlines()
    except UnicodeDecodeError:
        # OpenUSD quotes the damaged bytes.
        lines = []
    return lines[-1].strip()[:200] if lines else "it is damaged"


def _gaussians(prim: Any) -> Gaussians:
    """Return the Gaussians of a prim; raises `ValueError` for values of another number or type."""

    def get(name: str, *shape: int) -> NDArray[np.float32]:
        values = prim.GetAttribute(name).Get()
        if values is None:
            # Values of half precision have attributes of their own.
            values = prim.GetAttribute(f"{name}h").Get()
        if values is None:
            raise ValueError(f"it has no {name}")
        return np.array(values, np.float32).reshape(*shape)

    means = get("positions", -1, 3)
    count = len(means)
    degree = prim.GetAttribute("radiance:sphericalHarmonicsDegree").Get()
    if count == 0 or degree not in (0, 1, 2, 3):
        raise ValueError(f"it has {count} Gaussians with harmonics of degree {degree}")
    with np.errstate(invalid="ignore"):
        return Gaussians(
            means=means,
            log_scales=np.log(np.maximum(get("scales", count, 3), np.finfo(np.float32).tiny)),
            # In memory, as NumPy sees it, OpenUSD's real part is last.
            quats=np.roll(get("orientations", count, 4), 1, axis=1),
            opacity_logits=logits_of(get("opacities", count)),
            sh=get("radiance:sphericalHarmonicsCoefficients", count, (degree + 1) ** 2, 3),
        )
