# SPDX-License-Identifier: GPL-3.0-or-later
"""3D models of other people: Wavefront OBJ files in the furniture libraries (``.sh3f``) of Sweet Home 3D.

A library is a ZIP archive with ``PluginFurnitureCatalog.properties``, which names each model and its size in
centimetres. Its coordinates: x right, y up, z to the front.
"""

from __future__ import annotations

import io
import posixpath
import re
import zipfile
from collections import defaultdict
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from PIL import Image
from studio.shapes import Shape

from .stuffs import Glass, Pictured, Plain, Stuff
from .things import Part

_PROPERTIES = "PluginFurnitureCatalog.properties"
_SEEN_THROUGH = 0.7
"""Opacity below which a material is glass."""
_LARGEST_PICTURE = 1024
"""Longest side of a texture, in pixels: photos show exhibits smaller."""
_Corner = tuple[int, int]


class ModelError(Exception):
    """A folder holds no library, or a library cannot be read."""


@dataclass(frozen=True)
class Model:
    """A model of a library.

    Attributes
    ----------
    name
        As the library calls it, in English.
    archive, entry
        Path of the library, and of the OBJ file in it.
    size
        Width, depth and height in metres.
    rotation
        That the library applies to the coordinates of the file, [9], row by row.
    """

    name: str
    archive: str
    entry: str
    size: tuple[float, float, float]
    rotation: tuple[float, ...] = (1, 0, 0, 0, 1, 0, 0, 0, 1)

    def parts(self, scale: float) -> list[Part]:
        """Return the surfaces by material, `scale` times as large as the thing is; Z is up, the front looks to -Y.

        Raises
        ------
        ModelError
            When the file cannot be read.
        """
        try:
            with zipfile.ZipFile(self.archive) as library:
                return self._parts(library, scale)
        except (OSError, KeyError, ValueError, IndexError, zipfile.BadZipFile) as error:
            raise ModelError(f"The model {self.entry} of {self.archive} cannot be read: {error}.") from error

    def _parts(self, library: zipfile.ZipFile, scale: float) -> list[Part]:
        vertices, uvs, faces, materials = _read_obj(library.read(self.entry).decode("utf-8", "replace"))
        folder = posixpath.dirname(self.entry)
        stuffs: dict[str, Stuff] = {}
        for name in materials:
            stuffs |= _read_mtl(library, self.archive, folder, name)
        turned = vertices @ np.array(self.rotation).reshape(3, 3).T
        used = np.concatenate([np.array(corners)[:, :, 0].ravel() for corners in faces.values()])
        low, high = turned[used].min(axis=0), turned[used].max(axis=0)
        wide, deep, tall = self.size
        placed = (turned - low) / np.maximum(high - low, 1e-9) * np.array([wide, tall, deep]) * scale
        placed = np.stack([placed[:, 0], -placed[:, 2], placed[:, 1]], axis=1)
        return [
            Part(_shape(placed, uvs, corners), stuffs.get(name, Plain("#b0b0b0")))
            for name, corners in faces.items()
        ]  # fmt: skip


def read_models(folder: Path) -> list[Model]:
    """Return the models of all libraries of a folder, in the order of their files.

    Raises
    ------
    ModelError
        When there is none, or one cannot be read.
    """
    files = sorted(folder.glob("*.sh3f"))
    if not files:
        raise ModelError(f"{folder} holds no *.sh3f files. Install Debian's sweethome3d-furniture, which has some.")
    found = []
    for file in files:
        try:
            with zipfile.ZipFile(file) as library:
                text = library.read(_PROPERTIES).decode("latin-1")
            found += _listed(str(file), text)
        except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
            raise ModelError(f"{file} is no furniture library of Sweet Home 3D: {error}.") from error
    return found


def _listed(archive: str, text: str) -> list[Model]:
    lines = (line.split("=", 1) for line in text.splitlines() if "=" in line and not line.startswith("#"))
    values = {key.strip(): value.strip() for key, value in lines}
    found = []
    for key, name in values.items():
        number = re.fullmatch(r"name#(\d+)", key)
        if number is None:
            continue
        of = {what: values.get(f"{what}#{number[1]}", "") for what in ("model", "modelRotation")}
        wide, deep, tall = (float(values[f"{what}#{number[1]}"]) / 100 for what in ("width", "depth", "height"))
        turn = tuple(map(float, of["modelRotation"].split())) if of["modelRotation"] else Model.rotation
        found.append(Model(name, archive, of["model"].lstrip("/"), (wide, deep, tall), turn))
    return found


def _read_obj(text: str) -> tuple[np.ndarray, np.ndarray, dict[str, list[tuple[_Corner, _Corner, _Corner]]], list[str]]:
    """Return vertices [V, 3], texture coordinates [T, 2], triangles by material, and the names of material files.

    A corner is the numbers of its vertex and of its texture coordinate, which is -1 where there is none. A face with
    more corners becomes a fan.
    """
    vertices: list[list[float]] = []
    uvs: list[list[float]] = []
    faces: dict[str, list[tuple[_Corner, _Corner, _Corner]]] = defaultdict(list)
    materials: list[str] = []
    material = ""
    for line in text.splitlines():
        word, _, rest = line.strip().partition(" ")
        if word == "v":
            vertices.append([float(value) for value in rest.split()[:3]])
        elif word == "vt":
            uvs.append([float(value) for value in rest.split()[:2]])
        elif word == "usemtl":
            material = rest.strip()
        elif word == "mtllib":
            materials.append(rest.strip())
        elif word == "f":
            corners = [_corner(corner, len(vertices), len(uvs)) for corner in rest.split()]
            faces[material] += [(corners[0], one, other) for one, other in zip(corners[1:], corners[2:], strict=False)]
    return np.array(vertices), np.array(uvs).reshape(-1, 2), {k: v for k, v in faces.items() if v}, materials


def _corner(text: str, n_vertices: int, n_uvs: int) -> _Corner:
    """Return the numbers of a corner ``v``, ``v/vt``, ``v/vt/vn`` or ``v//vn``; negative ones count from the end."""
    vertex, *others = text.split("/")
    uv = int(others[0]) if others and others[0] else 0
    number = int(vertex)
    return (number - 1 if number > 0 else n_vertices + number), (uv - 1 if uv > 0 else n_uvs + uv if uv else -1)


def _shape(vertices: np.ndarray, uvs: np.ndarray, triangles: list[tuple[_Corner, _Corner, _Corner]]) -> Shape:
    corners = np.array(triangles)
    numbers, of = np.unique(corners[:, :, 0], return_inverse=True)
    of = of.reshape(-1, 3)
    coordinates = None
    if len(uvs) and (corners[:, :, 1] >= 0).all():
        coordinates = uvs[corners[:, [0, 1, 2, 2], 1]]
    return Shape(vertices[numbers], of[:, [0, 1, 2, 2]], coordinates)


def _read_mtl(library: zipfile.ZipFile, archive: str, folder: str, name: str) -> dict[str, Stuff]:
    """Return the materials of a file: a picture, a colour (taken for sRGB), or glass."""
    entries = {entry.lower(): entry for entry in library.namelist()}
    file = entries.get(posixpath.join(folder, name).lower())
    if file is None:
        return {}
    found: dict[str, dict[str, str]] = {}
    current: dict[str, str] = {}
    for line in library.read(file).decode("utf-8", "replace").splitlines():
        word, _, rest = line.strip().partition(" ")
        if word == "newmtl":
            current = found.setdefault(rest.strip(), {})
        elif word in ("Kd", "d", "map_Kd"):
            current[word] = rest.strip()
    stuffs: dict[str, Stuff] = {}
    for material, values in found.items():
        picture = entries.get(posixpath.join(folder, values.get("map_Kd", "").replace("\\", "/")).lower())
        rgb = [min(1.0, max(0.0, float(value))) for value in values.get("Kd", "0.7 0.7 0.7").split()[:3]]
        colour = "#" + "".join(f"{round(255 * value):02x}" for value in rgb)
        opacity = float((values.get("d") or "1").split()[-1])
        if opacity < _SEEN_THROUGH:
            stuffs[material] = Glass(colour, veil=max(0.06, opacity / 2))
        elif picture is not None and values.get("map_Kd"):
            stuffs[material] = Pictured(archive, picture)
        else:
            stuffs[material] = Plain(colour)
    return stuffs


@lru_cache(maxsize=64)
def read_picture(stuff: Pictured) -> np.ndarray:
    """Return the picture of a surface, uint8 [h, w, 3], sRGB.

    Raises
    ------
    ModelError
        When it cannot be read.
    """
    try:
        with zipfile.ZipFile(stuff.archive) as library:
            picture = Image.open(io.BytesIO(library.read(stuff.entry))).convert("RGB")
    except (OSError, KeyError, zipfile.BadZipFile) as error:
        raise ModelError(f"The picture {stuff.entry} of {stuff.archive} cannot be read: {error}.") from error
    picture.thumbnail((_LARGEST_PICTURE, _LARGEST_PICTURE))
    return np.asarray(picture)
