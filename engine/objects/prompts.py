"""Prompts: a text, clicks, a box or a mask, in pixels of the photo after EXIF rotation."""

from __future__ import annotations

import difflib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FormatError, HeritageError, MaskError, PromptError
from ..files import opened
from ..scene import Camera, CameraSet, PinholeCamera

__all__ = [
    "BoxPrompt",
    "ClickPrompt",
    "MaskPrompt",
    "Point",
    "Prompt",
    "TextPrompt",
    "camera_of_prompt",
    "describe_points",
    "describe_prompt",
    "load_mask",
    "parse_point",
    "parse_prompt",
    "parse_texts",
]

_MAX_MASK_PIXELS = 400_000_000  # by definition
"""As for photos."""

_MASK_FORMATS = ("PNG", "TIFF", "BMP", "JPEG", "WEBP", "GIF", "PPM")
"""Formats that Pillow decodes by itself: for some others it starts a program."""

_SAVE_AS_PNG = "Save it as PNG."


@dataclass(frozen=True)
class TextPrompt:
    """The name of an object, e.g. ``"vase"`` or ``"left vase"`` (`engine.objects.spatial`).

    Attributes
    ----------
    text : str
    camera : Camera or PinholeCamera, optional
        Where the user looks from, for left and right.

    Raises
    ------
    PromptError
        When the text is empty.
    """

    text: str
    camera: Camera | PinholeCamera | None = None

    def __post_init__(self) -> None:
        if not self.text.strip():
            raise PromptError("The prompt is empty. Type what the object is, for example: vase.")


@dataclass(frozen=True)
class Point:
    """A position in a photo in pixels; (0, 0) is the top left corner, x points right, y down."""

    photo: str
    x: float
    y: float


@dataclass(frozen=True)
class ClickPrompt:
    """One or several clicks on an object.

    Attributes
    ----------
    photo : str
        Photo of the first click.
    x, y : float
        Position of the first click; (0, 0) is the top left corner, x points right, y down.
    more : tuple of Point
        Further clicks on the same object, in this photo or others.
    excluded : tuple of Point
        Clicks on what does not belong to the object.
    """

    photo: str
    x: float
    y: float
    more: tuple[Point, ...] = ()
    excluded: tuple[Point, ...] = ()

    @property
    def clicks(self) -> tuple[Point, ...]:
        """All clicks on the object."""
        return (Point(self.photo, self.x, self.y), *self.more)


@dataclass(frozen=True)
class BoxPrompt:
    """A box in a photo, given by two opposite corners and stored with x0 < x1 and y0 < y1.

    `excluded` is that of `ClickPrompt`.

    Raises
    ------
    PromptError
        When the box is smaller than a pixel.
    """

    photo: str
    x0: float
    y0: float
    x1: float
    y1: float
    excluded: tuple[Point, ...] = ()

    def __post_init__(self) -> None:
        left, right = sorted((self.x0, self.x1))
        top, bottom = sorted((self.y0, self.y1))
        if right - left < 1 or bottom - top < 1:
            raise PromptError(f"The box {self.x0:g},{self.y0:g},{self.x1:g},{self.y1:g} is smaller than a pixel.")
        for name, value in (("x0", left), ("y0", top), ("x1", right), ("y1", bottom)):
            object.__setattr__(self, name, value)


@dataclass(frozen=True)
class MaskPrompt:
    """A picture of the photo's size, white where the object is; `excluded` is that of `ClickPrompt`."""

    photo: str
    mask: Path
    excluded: tuple[Point, ...] = ()


Prompt = TextPrompt | ClickPrompt | BoxPrompt | MaskPrompt


def parse_prompt(
    *,
    text: str | None = None,
    click: str | Sequence[str] | None = None,
    box: str | None = None,
    mask: str | None = None,
    excluded: Sequence[str] = (),
) -> Prompt:
    """Return a prompt from the options of the command line.

    Parameters
    ----------
    text : str, optional
        Name of the object.
    click : str or sequence of str, optional
        ``PHOTO=x,y``; several clicks mean one object.
    box : str, optional
        ``PHOTO=x0,y0,x1,y1``.
    mask : str, optional
        ``PHOTO=MASK.png``.
    excluded : sequence of str
        ``PHOTO=x,y`` of clicks on what does not belong to the object; not allowed with a text.

    Returns
    -------
    Prompt

    Raises
    ------
    PromptError
        When not exactly one prompt is given, or an option does not have its form.
    """
    clicks = [click] if isinstance(click, str) else list(click or ())
    if sum((text is not None, bool(clicks), box is not None, mask is not None)) != 1:
        raise PromptError("Give exactly one prompt: a text, a click, a box or a mask.")
    excluded_points = tuple(parse_point(point) for point in excluded)
    if text is not None:
        if excluded_points:
            raise PromptError("A text takes no clicks. Isolate it first, then correct the object with --refine.")
        return TextPrompt(text)
    if clicks:
        first, *more = (parse_point(point) for point in clicks)
        return ClickPrompt(first.photo, first.x, first.y, tuple(more), excluded_points)
    if box is not None:
        photo, (x0, y0, x1, y1) = _photo_and_numbers(box, 4, "PHOTO=x0,y0,x1,y1")
        return BoxPrompt(photo, x0, y0, x1, y1, excluded_points)
    assert mask is not None
    return _parse_mask(mask, excluded_points)


def parse_point(text: str) -> Point:
    """Return the click that ``PHOTO=x,y`` describes.

    Raises
    ------
    PromptError
        When `text` does not have this form.
    """
    photo, (x, y) = _photo_and_numbers(text, 2, "PHOTO=x,y")
    return Point(photo, x, y)


def parse_texts(text: str) -> list[str]:
    """Return the texts of a list such as ``"vase;teapot"`` in their order, without repetitions.

    Raises
    ------
    PromptError
        When the list is empty.
    """
    texts = list(dict.fromkeys(part.strip() for part in text.split(";") if part.strip()))
    if not texts:
        raise PromptError("The prompt is empty. Type what the object is, for example: vase.")
    return texts


def _photo_and_numbers(text: str, count: int, form: str) -> tuple[str, list[float]]:
    # Split at the last "=": the name of a photo may contain one, numbers never do.
    photo, equals, rest = text.rpartition("=")
    try:
        numbers = [float(part) for part in rest.split(",")]
    except ValueError:
        numbers = []
    if not equals or not photo or len(numbers) != count or not all(math.isfinite(number) for number in numbers):
        raise PromptError(f"{text!r} is not of the form {form}, in pixels from the photo's top left corner.")
    return photo, numbers


def _parse_mask(text: str, excluded: tuple[Point, ...]) -> MaskPrompt:
    splits = [(text[:i], text[i + 1 :]) for i, letter in enumerate(text) if letter == "="]
    splits = [(photo, mask) for photo, mask in splits if photo and mask]
    if not splits:
        raise PromptError(f"{text!r} is not of the form PHOTO=MASK.png.")
    # Both names may contain an "=": the mask is the part that is a file.
    photo, mask = next((split for split in splits if Path(split[1]).is_file()), splits[0])
    return MaskPrompt(photo, Path(mask), excluded)


def describe_prompt(prompt: Prompt) -> dict[str, Any]:
    """Return the prompt as JSON values, as ``object.json`` stores it."""
    if isinstance(prompt, TextPrompt):
        return {"kind": "text", "text": prompt.text}
    excluded = {"not": describe_points(prompt.excluded)} if prompt.excluded else {}
    if isinstance(prompt, ClickPrompt):
        clicks = {"clicks": describe_points(prompt.clicks)} if prompt.more else {}
        return {"kind": "click", "photo": prompt.photo, "x": prompt.x, "y": prompt.y, **clicks, **excluded}
    if isinstance(prompt, BoxPrompt):
        box = {"x0": prompt.x0, "y0": prompt.y0, "x1": prompt.x1, "y1": prompt.y1}
        return {"kind": "box", "photo": prompt.photo, **box, **excluded}
    return {"kind": "mask", "photo": prompt.photo, "mask": prompt.mask.name, **excluded}


def describe_points(points: Sequence[Point]) -> list[dict[str, Any]]:
    """Return clicks as JSON values, as ``object.json`` stores them."""
    return [{"photo": point.photo, "x": point.x, "y": point.y} for point in points]


def camera_of_prompt(prompt: Point | ClickPrompt | BoxPrompt | MaskPrompt, cameras: CameraSet) -> Camera:
    """Return the camera of the photo the prompt points into.

    Parameters
    ----------
    prompt : Point, ClickPrompt, BoxPrompt or MaskPrompt
    cameras : CameraSet

    Returns
    -------
    Camera

    Raises
    ------
    PromptError
        When the photo is unknown (the message then lists the nearest names) or was not registered, or when the click or
        the box lies outside of it.
    """
    camera = cameras.by_photo.get(prompt.photo)
    if camera is None:
        raise PromptError(_unknown_photo(prompt.photo, [c.photo for c in cameras.cameras], cameras.unregistered))
    size = f"{prompt.photo} is {camera.width} x {camera.height} pixels"
    if isinstance(prompt, Point | ClickPrompt) and not (0 <= prompt.x < camera.width and 0 <= prompt.y < camera.height):
        raise PromptError(f"The click {prompt.x:g},{prompt.y:g} lies outside of the photo: {size}.")
    if isinstance(prompt, BoxPrompt) and (
        prompt.x1 <= 0 or prompt.y1 <= 0 or prompt.x0 >= camera.width or prompt.y0 >= camera.height
    ):
        corners = f"{prompt.x0:g},{prompt.y0:g},{prompt.x1:g},{prompt.y1:g}"
        raise PromptError(f"The box {corners} lies outside of the photo: {size}.")
    return camera


def _unknown_photo(name: str, known: Sequence[str], unregistered: Sequence[str]) -> str:
    if name in unregistered:
        return f"{name} could not be placed among the other photos, so nothing can be picked in it. Use another photo."
    lowered = {photo.lower(): photo for photo in known}
    by_file = [photo for photo in known if Path(photo).name.lower() == Path(name).name.lower()]
    near = by_file or [lowered[close] for close in difflib.get_close_matches(name.lower(), lowered, n=3, cutoff=0.4)]
    if near:
        return f"No photo is called {name!r}. Did you mean {' or '.join(near)}?"
    return f"No photo is called {name!r}. Photos are called: {', '.join(known[:5])}."


def load_mask(path: Path, camera: Camera) -> NDArray[np.bool_]:
    """Return a mask picture as bool [camera.height, camera.width]: True where it is lighter than half.

    Raises
    ------
    MaskError
        When the file cannot be read, its size differs from the photo's, or no pixel of it is white.
    """
    from PIL import Image

    try:
        with opened(path, advice=_SAVE_AS_PNG) as stream, Image.open(stream, formats=_MASK_FORMATS) as picture:
            # Before a pixel is decoded: a small file may state a huge size.
            _require_size(path, picture.size, camera)
            wide = picture.mode.startswith("I")
            values = np.asarray(picture if wide else picture.convert("L"))
    except FormatError as error:
        raise MaskError(f"The mask {error}") from error
    except HeritageError:
        raise
    # Pillow's decoders raise exceptions of any type on damaged data.
    except Exception as error:
        raise MaskError(f"The mask {path} cannot be read: {error}. {_SAVE_AS_PNG}") from error
    mask = values > (32767 if wide else 127)
    if not mask.any():
        raise MaskError(f"The mask {path} is empty: no pixel is lighter than half. Paint the object white.")
    return mask


def _require_size(path: Path, size: tuple[int, int], camera: Camera) -> None:
    width, height = size
    if (width, height) != (camera.width, camera.height):
        raise MaskError(
            f"The mask {path} is {width} x {height} pixels, but {camera.photo} is {camera.width} x {camera.height}. "
            "Draw it over the photo itself."
        )
    if width * height > _MAX_MASK_PIXELS:
        raise MaskError(f"The mask {path} has {width} x {height} pixels, more than can be read safely.")
