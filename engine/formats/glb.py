"""Gaussians in a glTF 2.0 binary with the ratified extension KHR_gaussian_splatting.

glTF is Y up and the engine's world Z up: `y_up_from_z_up` is baked into positions, rotations and spherical
harmonics, so that viewers which ignore node transforms on splats show the object upright too.
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
from ..project_folder import atomic_write
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
_LARGEST_FILE = 2**32 - 1


def y_up_from_z_up() -> NDArray[np.float64]:
    """Return the 4x4 map from the engine's world (Z up) to glTF's (Y up): (x, y, z) -> (x, z, -y)."""
    return np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], dtype=np.float64)


def z_up_from_y_up() -> NDArray[np.float64]:
    """Return the inverse of `y_up_from_z_up`."""
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
    """Write `gaussians` as a GLB, atomically; an existing file is replaced.

    Parameters
    ----------
    path : Path
        The file.
    gaussians : Gaussians
        In the Z-up world; features are left out.
    name : str
        Of the node and the mesh.
    copyright : str, optional
        ``asset.copyright``: credit line or rights statement.
    extras : mapping, optional
        JSON values for ``asset.extras``: the museum record and how the object was made.
    color_fallback : bool
        Add ``COLOR_0``, so that viewers without the extension show a coloured point cloud.

    Raises
    ------
    NumericalError
        When a value is not finite.
    FormatError
        When the file would pass 4 GiB, which GLB cannot hold.
    DiskError
        When it cannot be written.
    """
    check_finite(gaussians)
    attributes = _attributes(transform_gaussians(gaussians, y_up_from_z_up()), color_fallback=color_fallback)
    document, blobs = _document(attributes, name=name, copyright=copyright, extras=extras)
    text = json.dumps(document, ensure_ascii=False, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    binary_length = sum(blob.nbytes for blob in blobs)
    total = 12 + 8 + len(text) + (8 + binary_length if blobs else 0)
    if total > _LARGEST_FILE:
        raise FormatError(
            f"{path} would take {total / 2**30:.1f} GiB and GLB ends at 4 GiB. Export fewer Gaussians or PLY."
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
        # 16 bits: 8 would show bands in the shadows, since the colour is stored linear.
        attributes["COLOR_0"] = np.round(color * 65535).astype(np.uint16)
    return attributes


def _sh_name(degree: int, order: int) -> str:
    return f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{order}"


def _document(
    attributes: dict[str, NDArray[Any]], *, name: str, copyright: str | None, extras: Mapping[str, Any] | None
) -> tuple[dict[str, Any], list[NDArray[Any]]]:
    """Return the JSON part and the arrays that follow it. All of them have rows of a multiple of 4 bytes."""
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
        # glTF allows no empty accessor: an empty object is a node without a mesh.
        del document["extensionsUsed"]
        return document, []
    blobs, accessors, views, offset = [], [], [], 0
    for values in attributes.values():
        blob = np.ascontiguousarray(values)
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": blob.nbytes, "target": _ARRAY_BUFFER})
        whole_number = blob.dtype == np.uint16
        accessor: dict[str, Any] = {
            "bufferView": len(views) - 1,
            "componentType": _USHORT if whole_number else _FLOAT,
            "count": len(blob),
            "type": _TYPES[blob.shape[1]],
        }
        if whole_number:
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
    """Return the Gaussians of a GLB laid out as `write_glb` does: one float primitive, no node transform.

    Raises
    ------
    FormatError
        When the file is no GLB, has no KHR_gaussian_splatting primitive, or is laid out in a way not read
        here.
    DiskError
        When it cannot be read.
    """
    document, binary = _read_chunks(path)
    try:
        if not any("mesh" in node for node in document["nodes"]) and document["asset"]["generator"].startswith(
            "Gaussian Heritage"
        ):
            return _no_gaussians()
        primitive = document["meshes"][0]["primitives"][0]
        if EXTENSION not in primitive.get("extensions", {}):
            raise FormatError(f"{path} holds no Gaussians: its mesh does not use {EXTENSION}. Choose another file.")
        if any(key in node for node in document["nodes"] for key in ("matrix", "rotation", "scale", "translation")):
            raise FormatError(
                f"{path} moves its Gaussians with a node transform, which is not read. Export them untransformed."
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
            raise FormatError(f"{path} is cut short: {len(data)} of {total} bytes are there. Copy or export it again.")
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
        raise FormatError(f"{path} keeps Gaussians quantised or interleaved, which is not read. Export plain floats.")
    width = {kind: number for number, kind in _TYPES.items()}[accessor["type"]]
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    values = np.frombuffer(binary, dtype="<f4", count=accessor["count"] * width, offset=start)
    return values.reshape(accessor["count"], width).astype(np.float32)
