"""Readers and writers of Gaussians: 3DGS PLY, SPZ, SOG, SPLAT, KSPLAT, glTF and USD; transforms of Gaussians."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .axes import Up, file_from_z_up
    from .glb import read_glb, write_glb
    from .kinds import READ_SUFFIXES, kind_of, read_other
    from .ksplat import read_ksplat
    from .origin import moved_far
    from .ply import PlyFile, read_ply, read_ply_file, write_ply
    from .render_mode import ANTIALIASED_NOTE
    from .sog import read_sog
    from .sog_writing import write_sog
    from .spherical_harmonics import SH_C0
    from .splat import read_splat
    from .spz import read_spz, write_spz
    from .table import DEFAULT_FORMAT, FORMATS, FileFacts, Format, WritingTools, format_of, write_mesh, write_scene
    from .transform import logits_of, transform_gaussians
    from .usd import has_openusd, write_usd
    from .usd_elsewhere import write_usd_elsewhere
    from .usd_reading import read_usd

__all__ = [
    "ANTIALIASED_NOTE",
    "DEFAULT_FORMAT",
    "FORMATS",
    "READ_SUFFIXES",
    "SH_C0",
    "FileFacts",
    "Format",
    "PlyFile",
    "Up",
    "WritingTools",
    "file_from_z_up",
    "format_of",
    "has_openusd",
    "kind_of",
    "logits_of",
    "moved_far",
    "read_glb",
    "read_ksplat",
    "read_other",
    "read_ply",
    "read_ply_file",
    "read_sog",
    "read_splat",
    "read_spz",
    "read_usd",
    "transform_gaussians",
    "write_glb",
    "write_mesh",
    "write_ply",
    "write_scene",
    "write_sog",
    "write_spz",
    "write_usd",
    "write_usd_elsewhere",
]

__getattr__ = lazy_exports(__name__, __file__)
