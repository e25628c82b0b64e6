"""Errors of pictures in the pixels of each Gaussian, on a card."""

from __future__ import annotations

from typing import Any

from ...rasterizer.gpu import Frame, Uniform, run_together


class ErrorSum:
    """Dispatches that add the errors of pictures of one size to the buffer ``errors`` [N] of a frame.

    Parameters
    ----------
    frame : Frame
        Of training, whose backward pass begins with the gradients of blending and their sums; the rest is not needed.
    optimiser : Uniform
        Its constants of a step.
    """

    def __init__(self, frame: Frame, optimiser: Uniform) -> None:
        self._frame = frame
        self._n_pixels = frame.size.width * frame.size.height
        self._uniform = frame._constants(self._n_pixels)
        names = ["totals", "counts", "errors", "status"]
        add = frame._step("errors", "add_errors", optimiser, names, frame._over(128))
        self.run = frame._submissions([*frame._backward.dispatches[:2], add])
        names = ["image", "photo", "gradient", "counts"]
        step = frame._step("errors", "error_gradient", self._uniform, names, -(-self._n_pixels // 256))
        self._gradient = frame._submissions([step])

    def add(self, pixels: Any) -> None:
        """Queue the errors of the image that was rendered last, compared with a photo."""
        frame = self._frame
        run_together(frame.gpu, [self._gradient, self.run], copies=[(pixels, frame.buffers["photo"])])
