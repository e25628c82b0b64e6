# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects, materials, lamps and sky in Blender, from descriptions."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix
from studio import materials
from studio.meshes import from_shape
from studio.stage import SEEN_THROUGH

from .models import read_picture
from .pictures import paint
from .stuffs import Glass, Mottled, Painted, Pictured, Plain, Stuff
from .things import Thing


class Workshop:
    """Builds things in the open scene; equal materials are made once."""

    def __init__(self) -> None:
        self._materials: dict[Stuff, bpy.types.Material] = {}

    def build(self, thing: Thing, name: str, where: tuple[float, float, float], turn: float, identity: int) -> None:
        """Build a thing at a place.

        Parameters
        ----------
        where, turn
            Position of its origin, and rotation about Z in degrees.
        identity
            Instance id in the masks.
        """
        pose = Matrix.Translation(where) @ Matrix.Rotation(np.radians(turn), 4, "Z")
        for part in thing.parts:
            made = from_shape(name, part.shape, self.material(part.stuff))
            made.matrix_world = pose
            made.pass_index = identity
            if isinstance(part.stuff, Glass) and part.stuff.hidden:
                made[SEEN_THROUGH] = True

    def material(self, stuff: Stuff) -> bpy.types.Material:
        """Return Blender's material of a description."""
        if stuff not in self._materials:
            self._materials[stuff] = _material(stuff, f"Stuff {len(self._materials)}")
        return self._materials[stuff]


def _material(stuff: Stuff, name: str) -> bpy.types.Material:
    if isinstance(stuff, Mottled):
        return materials.mottled(
            name,
            stuff.stops,
            stuff.scale,
            stuff.roughness,
            stuff.metallic,
            distortion=stuff.distortion,
            stretch=stuff.stretch,
            speckle=stuff.speckle,
            speckle_scale=stuff.speckle_scale,
            bump=stuff.bump,
        )
    if isinstance(stuff, Painted):
        picture = paint(stuff.pattern, stuff.colours, stuff.seed, stuff.size)
        return materials.painted(
            name, picture, stuff.roughness, stuff.metallic, stuff.wear, stuff.wear_scale, stuff.bump
        )
    if isinstance(stuff, Pictured):
        return materials.painted(name, read_picture(stuff), stuff.roughness, wear=0.0)
    if isinstance(stuff, Plain):
        return materials.plain(name, stuff.colour, stuff.roughness, stuff.metallic)
    return materials.thin_glass(name, stuff.tint, stuff.veil)
