"""Textured meshes of objects, from what the photos show of their Gaussians. docs/meshes.md describes the method."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .object_mesh import MeshResult, mesh_object

__getattr__ = lazy_exports(__name__, __file__)
