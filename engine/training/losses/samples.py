"""What a loss that has kernels of its own is evaluated on in one step on a graphics card."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, Protocol

from ...rasterizer.gpu import Frame, Submissions, Workspace
from ...scene import PinholeCamera


class CardLoss(Protocol):
    """Buffers and dispatches of a loss for pictures of one size."""

    def prepared(self, sample: Any) -> Submissions:
        """Copy a sample to the card and return the dispatches that add the loss and its gradient to the frame's."""


class Sample:
    """Base of the samples that a step's plan lists.

    Attributes
    ----------
    before_backward : bool
        Whether the loss adds to ``gradient``, which the backward pass reads. Otherwise it is evaluated after that pass,
        and adds to ``gradients`` or ``totals``.
    needs_features : bool
        Whether the Gaussians must have features, which are then trained in the step.
    """

    before_backward: ClassVar[bool] = False
    needs_features: ClassVar[bool] = False

    def sort(self) -> None:
        """Compute what the step needs now, and not when it is queued: another thread can do that ahead."""

    def check(self, camera: PinholeCamera, n_gaussians: int) -> None:
        """Raise ValueError if the sample does not fit its photo or the Gaussians: kernels do not check indices."""

    def found(self, workspace: Callable[[str], Workspace], room: int) -> Sample:
        """Return the sample with what is to be found on the card: itself where there is nothing.

        Parameters
        ----------
        workspace : callable
            Makes the buffers of a computation of that name, with the present parameters.
        room : int
            Gaussians that the buffers of the parameters hold.
        """
        return self

    def loss_on(self, frame: Frame) -> CardLoss:
        """Return the loss with its buffers for the pictures of `frame`, made once for each class of samples."""
        raise NotImplementedError
