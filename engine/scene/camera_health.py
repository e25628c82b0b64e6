"""The evidence of the photos against their cameras, in one sentence. Standard library only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

HealthColour = Literal["green", "yellow", "red"]
HEALTH_COLOURS: tuple[str, ...] = get_args(HealthColour)


@dataclass(frozen=True)
class CameraHealth:
    """The finding of the health check of a `CameraSet`.

    Attributes
    ----------
    colour : {"green", "yellow", "red"}
        Green: nothing speaks against the cameras. Yellow: a part of the photos is missing, or the cameras are less
        exact than usual. Red: the photos refute the cameras.
    cause : str
        Likely cause as one word of `engine.cameras.health`, empty when green.
    sentence : str
        The finding and what to do, as one sentence.
    refuted : tuple of str
        Photos whose place the other photos refute. They are among the unregistered photos of the `CameraSet`.
    """

    colour: HealthColour
    cause: str
    sentence: str
    refuted: tuple[str, ...] = ()
