"""Sparse points (or nothing but cameras) come in, Gaussians to start from go out; and the scene's files on disk."""

__all__: list[str] = []
