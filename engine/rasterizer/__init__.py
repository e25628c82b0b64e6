"""Gaussians and one camera come in, a picture of any number of channels goes out, with gradients for training."""

__all__: list[str] = []
