"""Writer of Gaussians as USD: one prim of the type ``ParticleField3DGaussianSplat``, which OpenUSD has since 26.03.

The values are those of the schema: linear scales, opacities in [0, 1], quaternions with the real part first, and the
coefficients of each Gaussian one after the other. Z is up, which the stage states.

OpenUSD (``pxr``) is imported when a file is written: the engine installs it on request (requirements/formats.txt), and
Blender brings its own.
"""

from __future__ import annotations

import functools
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from ..core.errors import DiskError, EnvironmentProblem, FormatError
from ..core.files import TEMPORARY_PREFIX
from ..core.system import replace_file
from ..scene import Gaussians, unit_quats
from .facts import NO_FACTS, FileFacts
from .origin import require_near
from .ply import check_finite
from .render_mode import RENDER_MODE, RENDER_MODE_KEY
from .transform import transform_gaussians

PRIM_TYPE = "ParticleField3DGaussianSplat"
_UNKNOWN_UNIT = "The unit of this file is unknown. metersPerUnit is 1 so that its numbers are shown as they are."
_MAX_COUNT = 20_000_000
"""Gaussians of a file: the arrays of OpenUSD are copies, and more than these need more memory than computers have."""


def write_usd(path: Path, gaussians: Gaussians, facts: FileFacts = NO_FACTS) -> None:
    """Write `gaussians` as binary USD (.usd, .usdc) or text (.usda) atomically, replacing an existing file.

    Parameters
    ----------
    gaussians : Gaussians
        In the engine's world (Z up). Features are not written.
    facts : FileFacts
        ``metres_per_unit`` of None is said in the stage's documentation and in ``customLayerData``. The stage states 1
        then: for USD's own default, 0.01, other programs show the Gaussians 100 times too small. The record is written
        as ``customLayerData``, `seen` as the attribute ``primvars:photosSeen``.

    Raises
    ------
    EnvironmentProblem
        When OpenUSD is missing, or does not know the type of prim.
    NumericalError
        When a value is not finite.
    FormatError
        When there are too many Gaussians, or they are moved too far away.
    DiskError
        When the file cannot be written.
    """
    require_openusd("or export PLY, GLB or SPZ")
    from pxr import Sdf, Usd, UsdGeom, Vt

    check_finite(gaussians)
    if len(gaussians) > _MAX_COUNT:
        raise FormatError(f"{path} would have {len(gaussians)} Gaussians; USD is limited to {_MAX_COUNT}. Export PLY.")
    require_near(gaussians, facts.matrix, path)
    turned = gaussians if facts.matrix is None else transform_gaussians(gaussians, facts.matrix)
    layer = Sdf.Layer.CreateAnonymous(path.suffix)
    stage = Usd.Stage.Open(layer)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0 if facts.metres_per_unit is None else facts.metres_per_unit)
    if facts.metres_per_unit is None:
        layer.documentation = _UNKNOWN_UNIT
    unit = {} if facts.metres_per_unit is not None else {"unit": "unknown"}
    mode = {RENDER_MODE_KEY: RENDER_MODE[True]} if gaussians.antialiased else {}
    layer.customLayerData = {"generator": f"Gaussian Heritage {__version__}", **unit, **mode, **(facts.extras or {})}
    prim = stage.DefinePrim("/Gaussians", PRIM_TYPE)
    stage.SetDefaultPrim(prim)
    prim.SetDisplayName(facts.name)

    def put(attribute: str, values: object) -> None:
        prim.GetAttribute(attribute).Set(values)

    put("positions", Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(turned.means)))
    put("scales", Vt.Vec3fArray.FromNumpy(turned.scales))
    put("opacities", Vt.FloatArray.FromNumpy(turned.opacities))
    # In memory, as NumPy sees it, OpenUSD's real part is last.
    xyzw = np.roll(unit_quats(turned.quats), -1, axis=1)
    put("orientations", Vt.QuatfArray.FromNumpy(np.ascontiguousarray(xyzw)))
    put("radiance:sphericalHarmonicsDegree", turned.sh_degree)
    coefficients = np.ascontiguousarray(turned.sh.reshape(-1, 3))
    put("radiance:sphericalHarmonicsCoefficients", Vt.Vec3fArray.FromNumpy(coefficients))
    put("projectionModeHint", "perspective")
    put("sortingModeHint", "cameraDistance")
    if len(turned):
        reach = 3 * turned.scales.max(axis=1, keepdims=True)
        corners = np.stack([(turned.means - reach).min(axis=0), (turned.means + reach).max(axis=0)])
        put("extent", Vt.Vec3fArray.FromNumpy(corners.astype(np.float32)))
    if facts.seen is not None:
        primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar("photosSeen", Sdf.ValueTypeNames.IntArray, "vertex")
        primvar.Set(Vt.IntArray.FromNumpy(facts.seen.astype(np.int32)))
    _save(layer, path)


@functools.cache
def has_openusd() -> bool:
    """Return whether this Python has an OpenUSD that knows the type of prim."""
    try:
        require_openusd("")
    except EnvironmentProblem:
        return False
    return True


def require_openusd(otherwise: str) -> None:
    """Raise `EnvironmentProblem` when OpenUSD is missing or too old; `otherwise` says what else to do."""
    try:
        from pxr import Usd
    except ImportError as error:
        raise EnvironmentProblem(
            "USD files need the package usd-core, which is not installed. Install requirements/formats.txt with pip, "
            f"{otherwise}."
        ) from error
    if Usd.SchemaRegistry().FindConcretePrimDefinition(PRIM_TYPE) is None:
        version = ".".join(str(number) for number in Usd.GetVersion()[1:])
        raise EnvironmentProblem(
            f"OpenUSD {version} does not know {PRIM_TYPE}, which 26.03 and newer do. Update usd-core, {otherwise}."
        )


def _save(layer: Any, path: Path) -> None:
    """Write the layer beside `path`, then replace `path`: OpenUSD writes to names, not to streams."""
    from pxr import Tf

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=TEMPORARY_PREFIX, dir=path.parent) as folder:
            temporary = Path(folder) / path.name
            if not layer.Export(str(temporary)):
                raise OSError("OpenUSD could not write it")
            with temporary.open("rb+") as stream:
                os.fsync(stream.fileno())
            replace_file(temporary, path)
    except (OSError, Tf.ErrorException) as error:
        reason = getattr(error, "strerror", None) or error
        raise DiskError(f"Could not write {path}: {reason}. Free some space or choose another folder.") from error
