"""Prompts as arguments of ``python -m engine segment``.

Every argument has the form ``--option=value``: names and ids, which may come from a .blend file of someone else, are
never taken for options.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass

from ...core.errors import PromptError
from ...core.words import join_texts, split_texts
from ...scene import PinholeCamera


@dataclass(frozen=True)
class Click:
    """A clicked pixel of a photo.

    Attributes
    ----------
    photo : str
        Name of the photo.
    x, y : float
        Pixels from the top left corner, after EXIF rotation.
    wanted : bool
        True if the pixel is part of the object, False if it is not.
    """

    photo: str
    x: float
    y: float
    wanted: bool = True

    def arguments(self) -> list[str]:
        """Return the engine's arguments for this click."""
        return [f"--{'click' if self.wanted else 'not'}={self.photo}={self.x:g},{self.y:g}"]


def name_arguments(name: str) -> list[str]:
    """Return the engine's arguments that name an object; none for an empty name."""
    return [f"--name={name}"] if name else []


def text_arguments(prompt: str, name: str = "", camera: PinholeCamera | None = None) -> list[str]:
    """Return the engine's arguments for a prompt of one or several texts.

    Parameters
    ----------
    camera : PinholeCamera, optional
        Where the user looks from, in the normalised world: left and right refer to this view.

    Raises
    ------
    PromptError
        When the prompt is empty, or one name is given to several objects.
    """
    texts = split_texts(prompt)
    if not texts:
        raise PromptError("Enter what to isolate: a prompt in words, or clicks on a photo.")
    if name and len(texts) > 1:
        listed = ", ".join(map(repr, texts))
        raise PromptError(
            f"{len(texts)} objects cannot have the same name {name!r}: {listed}. Leave the name empty, or put one text "
            "in quotation marks."
        )
    view = [] if camera is None else [f"--seen-from={_as_json(camera)}"]
    return [f"--prompt={join_texts(texts)}", *name_arguments(name), *view]


def any_word_arguments(texts: Sequence[str], model: str, folder: str = "") -> list[str]:
    """Return the engine's arguments that fetch a model and ask for refused texts again.

    Parameters
    ----------
    model : str
        Model that knows more words, of the catalogue.
    folder : str
        Folder with its files, used instead of the network; empty to download.
    """
    source = [f"--from={folder}"] if folder else []
    return [f"--prompt={join_texts(texts)}", f"--fetch={model}", *source]


def _as_json(camera: PinholeCamera) -> str:
    K = camera.K
    lens = {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}
    values = {name: float(value) for name, value in lens.items()}
    return json.dumps(
        {"width": camera.width, "height": camera.height, **values, "viewmat": camera.viewmat.tolist()}, allow_nan=False
    )


def click_arguments(clicks: Sequence[Click], name: str = "") -> list[str]:
    """Return the engine's arguments for one object from `clicks`.

    Raises
    ------
    PromptError
        When no click is on the object.
    """
    if not any(click.wanted for click in clicks):
        raise PromptError("Click the object at least once. Shift-clicks only mark what is not part of it.")
    return [*(argument for click in clicks for argument in click.arguments()), *name_arguments(name)]


def refine_arguments(object_id: str, clicks: Sequence[Click] = (), level: int | None = None) -> list[str]:
    """Return the engine's arguments that correct an object by `clicks`, or store another of its levels.

    Raises
    ------
    PromptError
        When neither clicks nor a level are given.
    """
    if not clicks and level is None:
        raise PromptError("Click what belongs to the object, or Shift-click what does not.")
    arguments = [f"--refine={object_id}", *(argument for click in clicks for argument in click.arguments())]
    return arguments if level is None else [*arguments, f"--level={level}"]
