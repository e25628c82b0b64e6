"""Gaussians in, files that other programs read out, and back: 3DGS PLY and glTF (KHR_gaussian_splatting)."""

from .glb import read_glb, write_glb
from .ply import read_ply, write_ply
from .transform import transform_gaussians

__all__ = ["read_glb", "read_ply", "transform_gaussians", "write_glb", "write_ply"]
