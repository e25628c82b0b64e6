"""Readers and writers of Gaussians as 3DGS PLY, SPZ, glTF (KHR_gaussian_splatting) and USD; transforms of Gaussians."""

from __future__ import annotations

from .axes import Up, file_from_z_up
from .glb import read_glb, write_glb
from .ply import PlyFile, read_ply, read_ply_file, write_ply
from .spherical_harmonics import SH_C0
from .spz import read_spz, write_spz
from .transform import logits_of, rotations_from_quats, transform_gaussians
from .usd import write_usd
from .usd_reading import read_usd

__all__ = [
    "SH_C0",
    "PlyFile",
    "Up",
    "file_from_z_up",
    "logits_of",
    "read_glb",
    "read_ply",
    "read_ply_file",
    "read_spz",
    "read_usd",
    "rotations_from_quats",
    "transform_gaussians",
    "write_glb",
    "write_ply",
    "write_spz",
    "write_usd",
]
