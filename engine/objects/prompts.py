"""Prompts: a text, clicks, a box or a mask, in pixels of the photo after EXIF rotation."""

from __future__ import annotations

import difflib
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.arrays import Mask
from ..core.errors import FormatError, HeritageError, MaskError, PromptError
from ..core.files import opened
from ..scene import Camera, CameraSet, PinholeCamera

Place = tuple[float, float]
"""x, y in pixels of a picture from its top left corner."""

_MASK_FORMATS = ("PNG", "TIFF", "BMP", "JPEG", "WEBP", "GIF", "PPM")
"""Formats that Pillow decodes by itself: for some others it starts a program."""

_SAVE_AS_PNG = "Save it as PNG."


@dataclass(frozen=True)
class TextPrompt:
    """The name of an object.

    Attributes
    ----------
    text : str
        E.g. ``"left vase"``.
    camera : Camera, PinholeCamera or None
        From which left and right are seen.

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
    """A click on an object, `more` clicks on it in any photo, and `excluded` ones on what does not belong to it."""

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
    """A box in a photo.

    Attributes
    ----------
    photo : str
    x0, y0, x1, y1 : float
        Two corners in pixels, in any order when given; then x0 < x1 and y0 < y1.
    excluded : tuple of Point
        As of `ClickPrompt`.

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
        (x0, x1), (y0, y1) = sorted((self.x0, self.x1)), sorted((self.y0, self.y1))
        if x1 - x0 < 1 or y1 - y0 < 1:
            raise PromptError(f"The box {self.x0:g},{self.y0:g},{self.x1:g},{self.y1:g} is smaller than a pixel.")
        # The class is frozen, its dictionary is not.
        vars(self).update(x0=x0, y0=y0, x1=x1, y1=y1)


@dataclass(frozen=True)
class MaskPrompt:
    """A picture of the photo's size, white where the object is; `excluded` is that of `ClickPrompt`."""

    photo: str
    mask: Path
    excluded: tuple[Point, ...] = ()


Prompt = TextPrompt | ClickPrompt | BoxPrompt | MaskPrompt


def parse_prompt(
    *,
    click: str | Sequence[str] | None = None,
    box: str | None = None,
    mask: str | None = None,
    excluded: Sequence[str] = (),
) -> Prompt:
    """Return a prompt from the options of the command line.

    Parameters
    ----------
    click : str or sequence of str, optional
        ``PHOTO=x,y``; several mean one object.
    box : str, optional
        ``PHOTO=x0,y0,x1,y1``.
    mask : str, optional
        ``PHOTO=MASK.png``.
    excluded : sequence of str
        Clicks on what does not belong to the object.

    Raises
    ------
    PromptError
        When not exactly one prompt is given, or one has another form.
    """
    clicks = [click] if isinstance(click, str) else list(click or ())
    if sum((bool(clicks), box is not None, mask is not None)) != 1:
        raise PromptError("Give exactly one prompt: a click, a box or a mask.")
    unwanted = tuple(parse_point(point) for point in excluded)
    if clicks:
        first, *more = (parse_point(point) for point in clicks)
        return ClickPrompt(first.photo, first.x, first.y, tuple(more), unwanted)
    if box is not None:
        photo, (x0, y0, x1, y1) = _photo_and_numbers(box, "PHOTO=x0,y0,x1,y1")
        return BoxPrompt(photo, x0, y0, x1, y1, unwanted)
    assert mask is not None
    splits = [(mask[:i], mask[i + 1 :]) for i in range(1, len(mask) - 1) if mask[i] == "="]
    if not splits:
        raise PromptError(f"{mask!r} is not of the form PHOTO=MASK.png.")
    # Both names may contain an "=": the mask is the part that is a file.
    photo, file = next((split for split in splits if Path(split[1]).is_file()), splits[0])
    return MaskPrompt(photo, Path(file), unwanted)


def parse_point(text: str) -> Point:
    """Return the click that ``PHOTO=x,y`` describes.

    Raises
    ------
    PromptError
        When `text` does not have this form.
    """
    photo, (x, y) = _photo_and_numbers(text, "PHOTO=x,y")
    return Point(photo, x, y)


def _photo_and_numbers(text: str, form: str) -> tuple[str, list[float]]:
    # Split at the last "=": the name of a photo may contain one, numbers never do.
    photo, _, rest = text.rpartition("=")
    try:
        numbers = [float(part) for part in rest.split(",")]
    except ValueError:
        numbers = []
    if not photo or len(numbers) != len(form.split(",")) or not all(map(math.isfinite, numbers)):
        raise PromptError(f"{text!r} is not of the form {form}, in pixels from the photo's top left corner.")
    return photo, numbers


def describe_prompt(prompt: Prompt) -> dict[str, Any]:
    """Return the prompt as JSON values, as ``object.json`` stores it."""
    if isinstance(prompt, TextPrompt):
        return {"kind": "text", "text": prompt.text}
    excluded = {"not": [asdict(point) for point in prompt.excluded]} if prompt.excluded else {}
    if isinstance(prompt, ClickPrompt):
        clicks = {"clicks": [asdict(point) for point in prompt.clicks]} if prompt.more else {}
        return {"kind": "click", **asdict(prompt.clicks[0]), **clicks, **excluded}
    if isinstance(prompt, BoxPrompt):
        box = {"x0": prompt.x0, "y0": prompt.y0, "x1": prompt.x1, "y1": prompt.y1}
        return {"kind": "box", "photo": prompt.photo, **box, **excluded}
    return {"kind": "mask", "photo": prompt.photo, "mask": prompt.mask.name, **excluded}


def camera_of_prompt(prompt: Point | ClickPrompt | BoxPrompt | MaskPrompt, cameras: CameraSet) -> Camera:
    """Return the camera of the photo the prompt points into.

    Raises
    ------
    PromptError
        When the photo is unknown or was not registered, or the click or box lies outside of it.
    """
    photo, known = prompt.photo, cameras.by_photo
    if photo not in known and photo in cameras.unregistered:
        raise PromptError(
            f"{photo} could not be placed among the other photos, so nothing can be picked in it. Use another photo."
        )
    if photo not in known:
        lowered = {name.lower(): name for name in known}
        near = [name for name in known if Path(name).name.lower() == Path(photo).name.lower()]
        near = near or [lowered[name] for name in difflib.get_close_matches(photo.lower(), lowered)]
        hint = f"Did you mean {' or '.join(near)}?" if near else f"Photos are called: {', '.join(list(known)[:5])}."
        raise PromptError(f"No photo is called {photo!r}. {hint}")
    width, height = known[photo].width, known[photo].height
    outside = f"lies outside of the photo: {photo} is {width} x {height} pixels."
    if isinstance(prompt, Point | ClickPrompt) and not (0 <= prompt.x < width and 0 <= prompt.y < height):
        raise PromptError(f"The click {prompt.x:g},{prompt.y:g} {outside}")
    if isinstance(prompt, BoxPrompt) and (prompt.x0 >= width or prompt.y0 >= height or min(prompt.x1, prompt.y1) <= 0):
        raise PromptError(f"The box {prompt.x0:g},{prompt.y0:g},{prompt.x1:g},{prompt.y1:g} {outside}")
    return known[photo]


def load_mask(path: Path, camera: Camera) -> Mask:
    """Return a mask picture: True where it is lighter than half.

    Returns
    -------
    array of shape [camera.height, camera.width], bool

    Raises
    ------
    MaskError
        When the file cannot be read, its size differs from the photo's, or no pixel of it is white.
    """
    from PIL import Image

    from ..photos import MAX_PIXELS

    try:
        with opened(path, advice=_SAVE_AS_PNG) as stream, Image.open(stream, formats=_MASK_FORMATS) as picture:
            # Before a pixel is decoded: a small file may state a huge size.
            stated = f"{picture.width} x {picture.height} pixels"
            if picture.size != (camera.width, camera.height):
                raise MaskError(
                    f"The mask {path} is {stated}, but {camera.photo} is {camera.width} x {camera.height}. "
                    "Draw it over the photo itself."
                )
            if picture.width * picture.height > MAX_PIXELS:
                raise MaskError(f"The mask {path} has {stated}, more than can be read safely.")
            wide = picture.mode.startswith("I")
            values = np.asarray(picture if wide else picture.convert("L"))
    except FormatError as error:
        raise MaskError(f"The mask {error}") from error
    except HeritageError:
        raise
    # Pillow's decoders raise exceptions of any type on damaged data.
    except Exception as error:
        raise MaskError(f"The mask {path} cannot be read: {error}. {_SAVE_AS_PNG}") from error
    # Pillow may hold the 16 bits of a wide picture in 32.
    mask = values > np.iinfo(np.uint16 if wide else np.uint8).max // 2
    if not mask.any():
        raise MaskError(f"The mask {path} is empty: no pixel is lighter than half. Paint the object white.")
    return mask
