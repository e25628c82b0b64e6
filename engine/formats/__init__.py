"""Readers and writers of Gaussians: 3DGS PLY, SPZ, SOG, SPLAT, KSPLAT, glTF and USD; transforms of Gaussians."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .axes import Up, file_from_z_up
    from .facts import FileFacts
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
    from .table import DEFAULT_FORMAT, FORMATS, Format, WritingTools, format_of, write_mesh, write_scene
    from .transform import logits_of, transform_gaussians
    from .usd import has_openusd, write_usd
    from .usd_elsewhere import write_usd_elsewhere
    from .usd_reading import read_usd

__getattr__ = lazy_exports(__name__, __file__)
