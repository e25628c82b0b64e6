"""Readers and writers of Gaussians as 3DGS PLY and glTF (KHR_gaussian_splatting), and transforms of Gaussians."""

from __future__ import annotations

from .glb import read_glb, write_glb
from .ply import read_ply, write_ply
from .spherical_harmonics import SH_C0
from .transform import logits_of, rotations_from_quats, transform_gaussians

__all__ = [
    "SH_C0",
    "logits_of",
    "read_glb",
    "read_ply",
    "rotations_from_quats",
    "transform_gaussians",
    "write_glb",
    "write_ply",
]
