"""Gaussians as a glTF 2.0 binary with the ratified extension KHR_gaussian_splatting.

Conventions of the file: metres by definition of glTF (the engine writes its world units), Y up, linear scales,
quaternions xyzw, opacities in [0, 1], spherical harmonics of sRGB colours. The engine has Z up, log-scales, quaternions
wxyz and opacity logits.

The writer turns positions, rotations and spherical harmonics to Y up instead of writing a node rotation,
because some viewers ignore node transforms on splats. The reader applies the inverse.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FormatError
from ..core.files import opened, optional, parse_json
from ..scene import Gaussians, unit_quats
from .bounds import require_memory, upright
from .facts import NO_FACTS, FileFacts
from .gltf import ARRAY_BUFFER, BIN_CHUNK, FLOAT, JSON_CHUNK, MAGIC, USHORT, document_of, write_parts
from .origin import require_near
from .ply import check_finite
from .render_mode import RENDER_MODE, RENDER_MODE_KEY
from .spherical_harmonics import SH_C0
from .transform import logits_of, transform_gaussians

EXTENSION = "KHR_gaussian_splatting"
_ROTATION = f"{EXTENSION}:ROTATION"
_SCALE = f"{EXTENSION}:SCALE"
_OPACITY = f"{EXTENSION}:OPACITY"
_SEEN = "_PHOTOS_SEEN"
_ROWS_PER_CHUNK = 1 << 16
"""Gaussians whose values are made at once."""
_TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
_MAX_JSON_BYTES = 16 << 20
_SCHEMA = {
    "asset": {"generator": optional(str), "extras": optional(object)},
    "nodes": [dict],
    "meshes": optional([{"primitives": [{"attributes": {str: int}, "extensions": optional(dict)}]}]),
    "accessors": optional(
        [{"bufferView": optional(int), "byteOffset": optional(int), "componentType": int, "count": int, "type": str}]
    ),
    "bufferViews": optional([{"buffer": int, "byteOffset": optional(int), "byteLength": int}]),
    "buffers": optional([dict]),
}
"""The parts of the JSON part that are read."""


def write_glb(path: Path, gaussians: Gaussians, facts: FileFacts = NO_FACTS) -> None:
    """Write `gaussians` as a GLB atomically, replacing an existing file.

    Parameters
    ----------
    gaussians : Gaussians
        In the engine's world (Z up). Features are not written.
    facts : FileFacts
        Its XMP is written with the extension KHR_xmp_json_ld, `seen` as the attribute ``_PHOTOS_SEEN``.

    Raises
    ------
    NumericalError
        When a value is not finite.
    FormatError
        When the file would exceed 4 GiB, the limit of GLB, or the Gaussians are moved too far away.
    DiskError
        When the file cannot be written.
    """
    check_finite(gaussians)
    require_near(gaussians, facts.matrix, path)
    if gaussians.antialiased:
        facts = replace(facts, extras={**(facts.extras or {}), RENDER_MODE_KEY: RENDER_MODE[True]})
    turned = transform_gaussians(gaussians, facts.transform("y"))
    attributes = _attributes(turned, facts.seen)
    document, n_bytes = _document(turned, attributes, facts)
    rows = (
        np.ascontiguousarray(attribute.values(slice(start, start + _ROWS_PER_CHUNK)), attribute.dtype).data
        for attribute in attributes.values()
        for start in range(0, len(turned), _ROWS_PER_CHUNK)
    )
    write_parts(path, document, rows, n_bytes, "Export fewer Gaussians, or as PLY.")


@dataclass(frozen=True)
class _Attribute:
    """Values of all Gaussians, made for some at a time."""

    width: int
    values: Callable[[slice], NDArray[Any]]
    dtype: str = "<f4"


def _attributes(gaussians: Gaussians, seen: NDArray[np.integer] | None) -> dict[str, _Attribute]:
    attributes = {
        "POSITION": _Attribute(3, lambda part: gaussians.means[part]),
        _ROTATION: _Attribute(4, lambda part: np.roll(unit_quats(gaussians.quats[part].astype(float)), -1, axis=1)),
        _SCALE: _Attribute(3, lambda part: gaussians[part].scales),
        _OPACITY: _Attribute(1, lambda part: gaussians[part].opacities),
    }
    for degree in range(gaussians.sh_degree + 1):
        for order in range(2 * degree + 1):
            index = degree * degree + order
            attributes[_sh_name(degree, order)] = _Attribute(3, _coefficient(gaussians, index))
    # Viewers without the extension show a coloured point cloud.
    attributes["COLOR_0"] = _Attribute(4, lambda part: _fallback_color(gaussians[part]), "<u2")
    if seen is not None:
        attributes[_SEEN] = _Attribute(1, lambda part: seen[part])
    return attributes


def _coefficient(gaussians: Gaussians, index: int) -> Callable[[slice], NDArray[Any]]:
    return lambda part: gaussians.sh[part, index]


def _fallback_color(gaussians: Gaussians) -> NDArray[np.float64]:
    srgb = np.clip(0.5 + SH_C0 * gaussians.sh[:, 0], 0, 1)
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    color = np.concatenate([linear, gaussians.opacities[:, None]], axis=1)
    # With 8 bits a linear colour would show bands in dark areas.
    return np.round(color * 65535)


def _sh_name(degree: int, order: int) -> str:
    return f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{order}"


def _document(gaussians: Gaussians, attributes: dict[str, _Attribute], facts: FileFacts) -> tuple[dict[str, Any], int]:
    """Return the JSON part, and the size of the binary part, whose rows have a multiple of 4 bytes."""
    document, count = document_of(facts), len(gaussians)
    if count == 0:
        # glTF does not allow an empty accessor: an object without Gaussians is a node without a mesh.
        return document, 0
    document["extensionsUsed"] = [EXTENSION, *document.get("extensionsUsed", [])]
    accessors, views, offset = [], [], 0
    for attribute in attributes.values():
        is_integer = attribute.dtype == "<u2"
        n_bytes = count * attribute.width * np.dtype(attribute.dtype).itemsize
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": n_bytes, "target": ARRAY_BUFFER})
        accessor: dict[str, Any] = {
            "bufferView": len(views) - 1,
            "componentType": USHORT if is_integer else FLOAT,
            "count": count,
            "type": _TYPES[attribute.width],
        }
        if is_integer:
            accessor["normalized"] = True
        accessors.append(accessor)
        offset += n_bytes
    accessors[0] |= {"min": gaussians.means.min(axis=0).tolist(), "max": gaussians.means.max(axis=0).tolist()}
    document["nodes"][0]["mesh"] = 0
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
    document["meshes"] = [{"name": facts.name, "primitives": [primitive]}]
    document |= {"accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": offset}]}
    return document, offset


def read_glb(path: Path) -> Gaussians:
    """Return the Gaussians of a GLB with the layout of `write_glb`: one primitive of floats, no node transform.

    Raises
    ------
    FormatError
        When the file cannot be read, is not a GLB, has no KHR_gaussian_splatting primitive, has another layout, takes
        values from another file, or has values that are not finite or too large.
    """
    with opened(path, advice="Check the path and its permissions.") as stream:
        document, binary = _read_head(stream, path)
        try:
            if not any("mesh" in node for node in document["nodes"]) and _is_ours(document):
                return _no_gaussians()
            gaussians = _gaussians(document, binary, _accessors_of_splats(document, path), path)
            extras = document["asset"].get("extras")
            is_mip = isinstance(extras, dict) and extras.get(RENDER_MODE_KEY) == RENDER_MODE[True]
            gaussians = replace(gaussians, antialiased=is_mip)
        except (KeyError, IndexError, ValueError) as error:
            raise FormatError(
                f"{path} is not a GLB with Gaussians that can be read ({error!r}). Export it again."
            ) from error
    return upright(gaussians, "y", path, "Export it again.")


def _accessors_of_splats(document: dict[str, Any], path: Path) -> dict[str, int]:
    """Return the accessors of the Gaussians by name; raises `KeyError` or `IndexError` for a missing part."""
    primitive = document["meshes"][0]["primitives"][0]
    if EXTENSION not in primitive.get("extensions", {}):
        raise FormatError(f"{path} contains no Gaussians: its mesh does not use {EXTENSION}. Choose another file.")
    if any(key in node for node in document["nodes"] for key in ("matrix", "rotation", "scale", "translation")):
        raise FormatError(
            f"{path} moves its Gaussians with a node transform, which is not supported. Export them untransformed."
        )
    if any("uri" in buffer for buffer in document["buffers"]):
        raise FormatError(f"{path} takes its values from another file. Export it as one binary file.")
    attributes: dict[str, int] = primitive["attributes"]
    return attributes


def _gaussians(document: dict[str, Any], binary: _BinaryPart, attributes: dict[str, int], path: Path) -> Gaussians:
    """Return the Gaussians in glTF's world; raises `KeyError`, `IndexError` or `ValueError` for a missing part."""
    count = document["accessors"][_index(attributes["POSITION"])]["count"]

    def read(name: str, width: int) -> NDArray[np.float32]:
        return _read_accessor(document, binary, attributes[name], (count, width), path)

    degree = max(degree for degree in range(4) if _sh_name(degree, 0) in attributes)
    names = [_sh_name(band, order) for band in range(degree + 1) for order in range(2 * band + 1)]
    with np.errstate(invalid="ignore"):
        means, quats = read("POSITION", 3), np.roll(read(_ROTATION, 4), 1, axis=1)
        log_scales = np.log(np.maximum(read(_SCALE, 3), np.finfo(np.float32).tiny))
        logits = logits_of(read(_OPACITY, 1)[:, 0].astype(np.float64))
    sh = np.empty((len(means), len(names), 3), np.float32)
    for number, name in enumerate(names):
        sh[:, number] = read(name, 3)
    return Gaussians(means, log_scales, quats, logits, sh)


def _is_ours(document: dict[str, Any]) -> bool:
    return bool(document["asset"].get("generator", "").startswith("Gaussian Heritage"))


def _no_gaussians() -> Gaussians:
    empty = np.zeros((0, 4), dtype=np.float32)
    return Gaussians(empty[:, :3], empty[:, :3], empty, empty[:, 0], np.zeros((0, 1, 3), dtype=np.float32))


@dataclass(frozen=True)
class _BinaryPart:
    """The binary part of an open GLB: `length` bytes from `begin` on, which are read piece by piece."""

    stream: IO[bytes]
    begin: int
    length: int

    def floats(self, start: int, shape: tuple[int, int]) -> NDArray[np.float32]:
        """Return the numbers from byte `start` on; raises `ValueError` when the file became shorter."""
        values = np.empty(shape, "<f4")
        self.stream.seek(self.begin + start)
        if cast(Any, self.stream).readinto(values.view(np.uint8)) < values.nbytes:
            raise ValueError("the file became shorter while it was read")
        return values.astype(np.float32, copy=False)


def _read_head(stream: IO[bytes], path: Path) -> tuple[dict[str, Any], _BinaryPart]:
    """Return the JSON part, checked, and the binary part of an open file."""
    size = stream.seek(0, os.SEEK_END)
    stream.seek(0)
    head = stream.read(20)
    if len(head) >= 12 and struct.unpack_from("<II", head) != (MAGIC, 2):
        raise FormatError(f"{path} is not a glTF 2.0 binary (.glb). Choose another file.")
    if len(head) < 20:
        raise FormatError(f"{path} is not a readable GLB: it has {len(head)} bytes. Copy or export it again.")
    _, _, total, length, kind = struct.unpack("<IIIII", head)
    if total != size:
        raise FormatError(f"{path} is truncated: it has {size} of {total} bytes. Copy or export it again.")
    if kind != JSON_CHUNK or length > min(size - 20, _MAX_JSON_BYTES):
        raise FormatError(f"{path} is not a readable GLB: it does not begin with its JSON part. Export it again.")
    text = stream.read(length).decode("utf-8", "replace")
    document = parse_json(text, _SCHEMA, source=str(path), advice="Copy or export it again.")
    head = stream.read(8)
    if not head:
        return document, _BinaryPart(stream, size, 0)
    length, kind = struct.unpack("<II", head) if len(head) == 8 else (0, 0)
    if kind != BIN_CHUNK or length > size - stream.tell():
        raise FormatError(f"{path} is not a readable GLB: its binary part is damaged. Copy or export it again.")
    # The arrays, and one attribute beside them.
    require_memory(path, length + length // 2)
    return document, _BinaryPart(stream, stream.tell(), length)


def _read_accessor(
    document: dict[str, Any], binary: _BinaryPart, index: int, shape: tuple[int, int], path: Path
) -> NDArray[np.float32]:
    accessor = document["accessors"][_index(index)]
    view = document["bufferViews"][_index(accessor["bufferView"])]
    if accessor["componentType"] != FLOAT or "byteStride" in view or "sparse" in accessor:
        raise FormatError(
            f"{path} has quantised or interleaved Gaussians, which is not supported. Export plain floats."
        )
    if view["buffer"] != 0 or (accessor["count"], accessor["type"]) != (shape[0], _TYPES[shape[1]]):
        raise ValueError("an attribute has another length or width")
    start, offset = _index(view.get("byteOffset", 0)), _index(accessor.get("byteOffset", 0))
    end = start + min(_index(view["byteLength"]), binary.length - start)
    n_bytes = 4 * _index(shape[0]) * shape[1]
    if n_bytes == 0 or start + offset + n_bytes > end:
        raise ValueError("an attribute is empty or is not inside of the file")
    return binary.floats(start + offset, shape)


def _index(number: int) -> int:
    if number < 0:
        raise ValueError(f"{number} is negative")
    return number
