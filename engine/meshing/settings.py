"""Settings of meshes. Standard library only, because the command line reads them."""

from __future__ import annotations

from dataclasses import dataclass

LEVELS = (5_000, 50_000, 500_000)
"""Numbers of triangles that are offered: for the web, for looking closely, and as fine as photos allow."""


@dataclass(frozen=True)
class MeshSettings:
    """How an object is meshed.

    Attributes
    ----------
    triangles : int
        Largest number of triangles.
    texture_side : int
        Width and height of the texture in pixels; 0: none, for files that hold none. Vertices have colours anyway.
    watertight : bool
        Whether the surface is closed where no photo saw it.
    max_photos : int
        Photos whose depths are fused and whose colours are taken, those that differ most.
    """

    triangles: int = 50_000
    texture_side: int = 2048
    watertight: bool = False
    max_photos: int = 48
