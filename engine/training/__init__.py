"""Gaussians to start from and photos with known cameras come in; Gaussians that look like the photos go out."""

__all__: list[str] = []
