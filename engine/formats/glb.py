"""Gaussians as a glTF 2.0 binary with the ratified extension KHR_gaussian_splatting.

Conventions of the file: metres by definition of glTF (the engine writes its world units), Y up, linear scales,
quaternions xyzw, opacities in [0, 1], spherical harmonics of sRGB colours. The engine has Z up, log-scales, quaternions
wxyz and opacity logits.

The writer applies `y_up_from_z_up` to positions, rotations and spherical harmonics instead of writing a node rotation,
because some viewers ignore node transforms on splats. The reader applies the inverse.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..errors import DiskError, FormatError
from ..files import atomic_write
from ..scene import Gaussians
from .ply import check_finite
from .spherical_harmonics import SH_C0
from .transform import logits_of, transform_gaussians

__all__ = ["EXTENSION", "read_glb", "write_glb", "y_up_from_z_up", "z_up_from_y_up"]

EXTENSION = "KHR_gaussian_splatting"
_ROTATION = f"{EXTENSION}:ROTATION"
_SCALE = f"{EXTENSION}:SCALE"
_OPACITY = f"{EXTENSION}:OPACITY"
_MAGIC, _JSON_CHUNK, _BIN_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942
_FLOAT, _USHORT, _ARRAY_BUFFER = 5126, 5123, 34962
_TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
_MAX_FILE_SIZE = 2**32 - 1
"""Bytes; the header of a GLB states its size as a 32 bit number."""


def y_up_from_z_up() -> NDArray[np.float64]:
    """Return the rotation [4, 4] from the engine's world (Z up) to glTF's (Y up): (x, y, z) becomes (x, z, -y)."""
    return np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], dtype=np.float64)


def z_up_from_y_up() -> NDArray[np.float64]:
    """Return the rotation [4, 4] from glTF's world to the engine's, the inverse of `y_up_from_z_up`."""
    return y_up_from_z_up().T


def write_glb(
    path: Path,
    gaussians: Gaussians,
    *,
    name: str = "Gaussians",
    copyright: str | None = None,
    extras: Mapping[str, Any] | None = None,
    color_fallback: bool = True,
) -> None:
    """Write `gaussians` as a GLB atomically, replacing an existing file.

    Parameters
    ----------
    path : Path
    gaussians : Gaussians
        In the engine's world (Z up). Features are not written.
    name : str
        Name of the node and the mesh.
    copyright : str, optional
        ``asset.copyright``: credit line or rights statement.
    extras : mapping, optional
        JSON values for ``asset.extras``, e.g. the museum record.
    color_fallback : bool
        Whether to add ``COLOR_0``, with which viewers without the extension show a coloured point cloud.

    Raises
    ------
    NumericalError
        When a value is not finite.
    FormatError
        When the file would exceed 4 GiB, the limit of GLB.
    DiskError
        When the file cannot be written.
    """
    check_finite(gaussians)
    attributes = _attributes(transform_gaussians(gaussians, y_up_from_z_up()), color_fallback=color_fallback)
    document, blobs = _document(attributes, name=name, copyright=copyright, extras=extras)
    text = json.dumps(document, ensure_ascii=False, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    binary_length = sum(blob.nbytes for blob in blobs)
    total = 12 + 8 + len(text) + (8 + binary_length if blobs else 0)
    if total > _MAX_FILE_SIZE:
        raise FormatError(
            f"{path} would take {total / 2**30:.1f} GiB; GLB is limited to 4 GiB. Export fewer Gaussians, or as PLY."
        )
    with atomic_write(path) as stream:
        stream.write(struct.pack("<III", _MAGIC, 2, total))
        stream.write(struct.pack("<II", len(text), _JSON_CHUNK) + text)
        if blobs:
            stream.write(struct.pack("<II", binary_length, _BIN_CHUNK))
            for blob in blobs:
                stream.write(blob.data)


def _attributes(gaussians: Gaussians, *, color_fallback: bool) -> dict[str, NDArray[Any]]:
    lengths = np.linalg.norm(gaussians.quats.astype(np.float64), axis=1, keepdims=True)
    unit = np.where(lengths > 0, gaussians.quats / np.where(lengths > 0, lengths, 1), (1.0, 0.0, 0.0, 0.0))
    attributes: dict[str, NDArray[Any]] = {
        "POSITION": gaussians.means,
        _ROTATION: np.roll(unit, -1, axis=1).astype(np.float32),
        _SCALE: gaussians.scales,
        _OPACITY: gaussians.opacities[:, None],
    }
    for degree in range(gaussians.sh_degree + 1):
        for order in range(2 * degree + 1):
            attributes[_sh_name(degree, order)] = gaussians.sh[:, degree * degree + order]
    if color_fallback:
        srgb = np.clip(0.5 + SH_C0 * gaussians.sh[:, 0], 0, 1)
        linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
        color = np.concatenate([linear, gaussians.opacities[:, None]], axis=1)
        # With 8 bits a linear colour would show bands in dark areas.
        attributes["COLOR_0"] = np.round(color * 65535).astype(np.uint16)
    return attributes


def _sh_name(degree: int, order: int) -> str:
    return f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{order}"


def _document(
    attributes: dict[str, NDArray[Any]], *, name: str, copyright: str | None, extras: Mapping[str, Any] | None
) -> tuple[dict[str, Any], list[NDArray[Any]]]:
    """Return the JSON part and the arrays of the binary part, whose rows have a multiple of 4 bytes."""
    asset: dict[str, Any] = {"version": "2.0", "generator": f"Gaussian Heritage {__version__}"}
    if copyright:
        asset["copyright"] = copyright
    if extras:
        asset["extras"] = dict(extras)
    node: dict[str, Any] = {"name": name}
    document: dict[str, Any] = {
        "asset": asset,
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [node],
    }
    if len(attributes["POSITION"]) == 0:
        # glTF does not allow an empty accessor: an object without Gaussians is a node without a mesh.
        del document["extensionsUsed"]
        return document, []
    blobs, accessors, views, offset = [], [], [], 0
    for values in attributes.values():
        blob = np.ascontiguousarray(values)
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": blob.nbytes, "target": _ARRAY_BUFFER})
        is_integer = blob.dtype == np.uint16
        accessor: dict[str, Any] = {
            "bufferView": len(views) - 1,
            "componentType": _USHORT if is_integer else _FLOAT,
            "count": len(blob),
            "type": _TYPES[blob.shape[1]],
        }
        if is_integer:
            accessor["normalized"] = True
        accessors.append(accessor)
        blobs.append(blob)
        offset += blob.nbytes
    accessors[0]["min"] = attributes["POSITION"].min(axis=0).tolist()
    accessors[0]["max"] = attributes["POSITION"].max(axis=0).tolist()
    node["mesh"] = 0
    primitive = {
        "attributes": {key: index for index, key in enumerate(attributes)},
        "mode": 0,
        "extensions": {
            EXTENSION: {
                "kernel": "ellipse",
                "colorSpace": "srgb_rec709_display",
                "projection": "perspective",
                "sortingMethod": "cameraDistance",
            }
        },
    }
    document["meshes"] = [{"name": name, "primitives": [primitive]}]
    document |= {"accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": offset}]}
    return document, blobs


def read_glb(path: Path) -> Gaussians:
    """Return the Gaussians of a GLB with the layout of `write_glb`: one primitive of floats, no node transform.

    Raises
    ------
    FormatError
        When the file is not a GLB, has no KHR_gaussian_splatting primitive, or has another layout.
    DiskError
        When the file cannot be read.
    """
    document, binary = _read_chunks(path)
    try:
        if not any("mesh" in node for node in document["nodes"]) and document["asset"]["generator"].startswith(
            "Gaussian Heritage"
        ):
            return _no_gaussians()
        primitive = document["meshes"][0]["primitives"][0]
        if EXTENSION not in primitive.get("extensions", {}):
            raise FormatError(f"{path} contains no Gaussians: its mesh does not use {EXTENSION}. Choose another file.")
        if any(key in node for node in document["nodes"] for key in ("matrix", "rotation", "scale", "translation")):
            raise FormatError(
                f"{path} moves its Gaussians with a node transform, which is not supported. Export them untransformed."
            )
        arrays = {
            key: _read_accessor(document, binary, index, path)
            for key, index in primitive["attributes"].items()
            if key == "POSITION" or key.startswith(EXTENSION)
        }
        degree = max(degree for degree in range(4) if _sh_name(degree, 0) in arrays)
        coefficients = [arrays[_sh_name(band, order)] for band in range(degree + 1) for order in range(2 * band + 1)]
        opacity = arrays[_OPACITY][:, 0].astype(np.float64)
        gaussians = Gaussians(
            means=arrays["POSITION"],
            log_scales=np.log(np.maximum(arrays[_SCALE], np.finfo(np.float32).tiny)),
            quats=np.roll(arrays[_ROTATION], 1, axis=1),
            opacity_logits=logits_of(opacity),
            sh=np.stack(coefficients, axis=1),
        )
    except (KeyError, IndexError, ValueError, TypeError) as error:
        raise FormatError(
            f"{path} is not a GLB with Gaussians that can be read ({error!r}). Export it again."
        ) from error
    return transform_gaussians(gaussians, z_up_from_y_up())


def _no_gaussians() -> Gaussians:
    empty = np.zeros((0, 4), dtype=np.float32)
    return Gaussians(empty[:, :3], empty[:, :3], empty, empty[:, 0], np.zeros((0, 1, 3), dtype=np.float32))


def _read_chunks(path: Path) -> tuple[dict[str, Any], bytes]:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DiskError(
            f"Could not read {path}: {error.strerror or error}. Check the path and its permissions."
        ) from error
    try:
        magic, version, total = struct.unpack_from("<III", data, 0)
        if magic != _MAGIC or version != 2:
            raise FormatError(f"{path} is not a glTF 2.0 binary (.glb). Choose another file.")
        if total != len(data):
            raise FormatError(f"{path} is truncated: it has {len(data)} of {total} bytes. Copy or export it again.")
        length, kind = struct.unpack_from("<II", data, 12)
        if kind != _JSON_CHUNK:
            raise FormatError(f"{path} is not a readable GLB: it does not begin with its JSON part. Export it again.")
        document = json.loads(data[20 : 20 + length])
    except (struct.error, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise FormatError(f"{path} is not a readable GLB ({error}). Copy or export it again.") from error
    return document, data[20 + length + 8 :]


def _read_accessor(document: dict[str, Any], binary: bytes, index: int, path: Path) -> NDArray[np.float32]:
    accessor = document["accessors"][index]
    view = document["bufferViews"][accessor["bufferView"]]
    if accessor["componentType"] != _FLOAT or "byteStride" in view or "sparse" in accessor:
        raise FormatError(
            f"{path} has quantised or interleaved Gaussians, which is not supported. Export plain floats."
        )
    width = {kind: number for number, kind in _TYPES.items()}[accessor["type"]]
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    values = np.frombuffer(binary, dtype="<f4", count=accessor["count"] * width, offset=start)
    return values.reshape(accessor["count"], width).astype(np.float32)
