"""Gaussians and a camera come in; pictures in the pixels of the photo, and votes of pixels for Gaussians, go out."""

__all__: list[str] = []
