"""What a curator asks for, as arguments of ``python -m engine segment``; and clicks while they are gathered. No bpy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Literal

from ..engine.errors import PromptError

__all__ = ["Answer", "Click", "ClickSession", "click_arguments", "refine_arguments", "split_texts", "text_arguments"]


@dataclass(frozen=True)
class Click:
    """A pixel of a photo.

    Attributes
    ----------
    photo : str
        Its name.
    x, y : float
        Pixels from its top left corner, after EXIF rotation.
    wanted : bool
        True where the object lies; False for what is not part of it.
    """

    photo: str
    x: float
    y: float
    wanted: bool = True

    def arguments(self) -> list[str]:
        """Return the engine's arguments for this click."""
        return ["--click" if self.wanted else "--not", f"{self.photo}={self.x:g},{self.y:g}"]


def split_texts(prompt: str) -> list[str]:
    """Return the texts of a prompt such as ``"vase; teapot"``."""
    return [text.strip() for text in prompt.split(";") if text.strip()]


def text_arguments(prompt: str, name: str = "") -> list[str]:
    """Return the engine's arguments for a prompt of one or several texts.

    Raises
    ------
    PromptError
        When nothing is asked for, or one name is given to several things.
    """
    texts = split_texts(prompt)
    if not texts:
        raise PromptError("Say what to isolate: a prompt in words, or a photo with a pixel in it.")
    if name and len(texts) > 1:
        raise PromptError(f"{len(texts)} things cannot all be called {name!r}. Leave the name empty.")
    return ["--prompt", ";".join(texts), *(["--name", name] if name else [])]


def click_arguments(clicks: Sequence[Click], name: str = "") -> list[str]:
    """Return the engine's arguments for one object that all `clicks` are about.

    Raises
    ------
    PromptError
        When no click says where it is.
    """
    if not any(click.wanted for click in clicks):
        raise PromptError("Click the object at least once; Shift-clicks only say what is not part of it.")
    return [*(word for click in clicks for word in click.arguments()), *(["--name", name] if name else [])]


def refine_arguments(object_id: str, clicks: Sequence[Click] = (), level: int | None = None) -> list[str]:
    """Return the engine's arguments that correct an object, or keep another of its levels.

    Raises
    ------
    PromptError
        When nothing would change.
    """
    if not clicks and level is None:
        raise PromptError("Click what belongs to the object or, with Shift, what does not.")
    arguments = ["--refine", object_id, *(word for click in clicks for word in click.arguments())]
    return arguments if level is None else [*arguments, "--level", str(level)]


class Answer(Enum):
    """What becomes of an event of the window."""

    LEAVE = "not ours: Blender handles it"
    TAKEN = "a click was added or taken back, or there is nothing to do"
    OTHER_PHOTO = "the photo changes by `ClickSession.step`"
    DONE = "the clicks are complete"
    STOPPED = "the person changed their mind"


_DONE_KEYS = {"RET", "NUMPAD_ENTER"}
_STOP_KEYS = {"ESC", "RIGHTMOUSE"}
_BACK_KEYS = {"BACK_SPACE", "DEL"}
_PHOTO_KEYS: dict[str, Literal[-1, 1]] = {"LEFT_ARROW": -1, "RIGHT_ARROW": 1}


@dataclass
class ClickSession:
    """Clicks on photos, gathered until Enter.

    Attributes
    ----------
    clicks : list of Click
    step : int
        Where `Answer.OTHER_PHOTO` goes: -1 or 1.
    """

    clicks: list[Click] = field(default_factory=list)
    step: int = 1

    def handle(self, key: str, *, pressed: bool, negative: bool, click: Callable[[bool], Click]) -> Answer:
        """Take one event of the window.

        Parameters
        ----------
        key : str
            Blender's ``Event.type``.
        pressed : bool
            Of a key or button that goes down.
        negative : bool
            Shift or Ctrl is held.
        click : callable
            Gives the `Click` under the mouse, for its `wanted`; may raise a `HeritageError`.
        """
        if not pressed:
            return Answer.LEAVE
        if key == "LEFTMOUSE":
            self.clicks.append(click(not negative))
        elif key in _BACK_KEYS:
            del self.clicks[-1:]
        elif key in _DONE_KEYS:
            return Answer.DONE
        elif key in _STOP_KEYS:
            return Answer.STOPPED
        elif key in _PHOTO_KEYS:
            self.step = _PHOTO_KEYS[key]
            return Answer.OTHER_PHOTO
        else:
            return Answer.LEAVE
        return Answer.TAKEN

    def line(self) -> str:
        """Return how many clicks there are, for a person."""
        wanted = sum(click.wanted for click in self.clicks)
        return f"{wanted} on the object, {len(self.clicks) - wanted} beside it"
