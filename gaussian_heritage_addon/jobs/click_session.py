"""Clicks on photos, collected until Enter is pressed. Does not import bpy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Literal

from ...engine.workers.jobs import Click


class EventResult(Enum):
    """Effect of a window event on a click session."""

    IGNORED = "Blender handles the event"
    HANDLED = "a click was added or removed"
    CHANGE_PHOTO = "move on by `ClickSession.step` photos"
    CONFIRMED = "the clicks are complete"


CONFIRM_KEYS = frozenset(("RET", "NUMPAD_ENTER"))
"""Keys that complete a session."""
_UNDO_KEYS = {"BACK_SPACE", "DEL"}
_PHOTO_KEYS: dict[str, Literal[-1, 1]] = {"LEFT_ARROW": -1, "RIGHT_ARROW": 1}


@dataclass
class ClickSession:
    """Clicks on photos, collected until Enter is pressed.

    Attributes
    ----------
    clicks : list of Click
    step : int
        Direction of `EventResult.CHANGE_PHOTO`: -1 or 1.
    """

    clicks: list[Click] = field(default_factory=list)
    step: int = 1

    def handle(self, key: str, *, pressed: bool, negative: bool, click: Callable[[bool], Click]) -> EventResult:
        """Handle one window event.

        Parameters
        ----------
        key : str
            Blender's ``Event.type``.
        pressed : bool
            Whether the key or button is pressed, not released.
        negative : bool
            Whether Shift or Ctrl is held.
        click : callable
            Returns the `Click` under the mouse, given its `wanted`. May raise a `HeritageError`.
        """
        if not pressed:
            return EventResult.IGNORED
        if key == "LEFTMOUSE":
            self.clicks.append(click(not negative))
        elif key in _UNDO_KEYS:
            del self.clicks[-1:]
        elif key in CONFIRM_KEYS:
            return EventResult.CONFIRMED
        elif key in _PHOTO_KEYS:
            self.step = _PHOTO_KEYS[key]
            return EventResult.CHANGE_PHOTO
        else:
            return EventResult.IGNORED
        return EventResult.HANDLED

    def counts(self) -> tuple[int, int]:
        """Return the numbers of clicks on the object and beside it."""
        positive = sum(click.wanted for click in self.clicks)
        return positive, len(self.clicks) - positive
