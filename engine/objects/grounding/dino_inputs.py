"""Inputs of Grounding DINO: a caption as token ids, and a photo as a normalised tensor."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.arrays import Float32, Int64, Pixels
from ...core.errors import PromptError
from .tokenizer_file import open_tokenizer

# Mean and standard deviation of the Swin backbone's training pictures, RGB, 0 to 1.
_MEAN = np.array([0.485, 0.456, 0.406], np.float32)
_DEVIATION = np.array([0.229, 0.224, 0.225], np.float32)
_SHORTEST_SIDE, _LONGEST_SIDE = 800, 1333
MAX_TOKENS = 256


def to_caption(prompt: str) -> str:
    """Return `prompt` in the form of the model's training captions: in lower case, ending with " .".

    Raises
    ------
    PromptError
        When it contains no words.

    Notes
    -----
    A caption is always one phrase. "." and "?" separate phrases, but the public ONNX exports were traced with a single
    phrase: the mask that separates phrases is a constant in their graph, so a second phrase would be processed wrongly
    without an error. Both marks are therefore replaced with spaces.
    """
    words = " ".join(re.sub(r"[.?]", " ", prompt.lower()).split())
    if not words:
        raise PromptError("The prompt is empty. Type what the object is, for example: vase.")
    return f"{words} ."


@dataclass(frozen=True)
class Tokens:
    """A caption as input of the model.

    Attributes
    ----------
    ids, attention : arrays of shape [1, L], int64
        ``attention`` is 1 for tokens and 0 for padding.
    words : tuple of str
        The text of each token, empty for special ones and padding.
    """

    ids: Int64
    attention: Int64
    words: tuple[str, ...]


class Tokenizer:
    """The tokenizer of bert-base-uncased, read from its ``tokenizer.json``.

    Raises
    ------
    ModelFileError
        When the file is missing or damaged.
    EnvironmentProblem
        When the package ``tokenizers`` is missing.
    """

    def __init__(self, path: Path) -> None:
        self._tokenizer = open_tokenizer(path, "grounding-dino-tokenizer")

    def __call__(self, text: str, length: int | None) -> Tokens:
        """Return the tokens of `text`, padded to `length` if the export has a fixed length.

        Raises
        ------
        PromptError
            When the text is too long.
        """
        encoded = self._tokenizer.encode(text)
        ids, special = list(encoded.ids), list(encoded.special_tokens_mask)
        max_tokens = min(length or MAX_TOKENS, MAX_TOKENS)
        if len(ids) > max_tokens:
            raise PromptError(
                f"The prompt has {len(ids)} word pieces; the model reads at most {max_tokens}. Use fewer words."
            )
        padding = (length or len(ids)) - len(ids)
        attention = [1] * len(ids) + [0] * padding
        words = ["" if is_special else token for token, is_special in zip(encoded.tokens, special, strict=True)]
        return Tokens(
            np.array([ids + [0] * padding], np.int64), np.array([attention], np.int64), (*words, *[""] * padding)
        )


def resized_size(
    height: int, width: int, shortest: int = _SHORTEST_SIDE, longest: int = _LONGEST_SIDE
) -> tuple[int, int]:
    """Return height and width of a photo resized so that its shorter side is `shortest`, its longer at most `longest`.

    Truncates and rounds in the same places as the model's own preprocessing, so that its feature grid is the same.
    """
    small, large = min(height, width), max(height, width)
    exact = float(shortest)
    if large / small * shortest > longest:
        exact = longest * small / large
    rounded = round(exact)
    longer = max(1, int((exact if exact != shortest else rounded) * large / small))
    if rounded == small:
        return height, width
    return (rounded, longer) if height <= width else (longer, rounded)


def normalise_picture(pixels: Pixels, size: tuple[int, int]) -> Float32:
    """Return a photo as the model's input, shape [1, 3, h, w], float32.

    Parameters
    ----------
    pixels : array of shape [H, W, 3], uint8, sRGB
    size : (int, int)
        h, w. The aspect ratio may change, because boxes are returned as fractions of the photo.
    """
    from PIL import Image

    height, width = size
    # Pillow's bilinear filter is widened when a picture is reduced; the model was trained with it.
    resized = np.asarray(Image.fromarray(pixels).resize((width, height), Image.Resampling.BILINEAR), np.float32)
    normalised = (resized * np.float32(1 / 255) - _MEAN) / _DEVIATION
    return np.ascontiguousarray(normalised.transpose(2, 0, 1)[None], np.float32)
