"""What Grounding DINO is fed: a caption as token ids, and a photo as a normalised tensor."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import EnvironmentProblem, ModelFileError, PromptError

__all__ = ["Tokens", "caption", "load_tokenizer", "picture", "resized_size"]

# Of the pictures that the Swin backbone was trained on, RGB, 0 to 1.
_MEAN = np.array([0.485, 0.456, 0.406], np.float32)
_DEVIATION = np.array([0.229, 0.224, 0.225], np.float32)
_SHORTEST, _LONGEST = 800, 1333
MAX_TOKENS = 256


def caption(prompt: str) -> str:
    """Return `prompt` as the model was trained on captions: in lower case, ending with " .".

    Raises
    ------
    PromptError
        When nothing is left of it.

    Notes
    -----
    Always one phrase a call. "." and "?" part phrases, and the public ONNX exports were traced with a single one: the
    mask that keeps phrases apart is frozen in their graph, so a second phrase would be read wrongly, without an
    error. Both marks inside a prompt therefore become spaces.
    """
    words = " ".join(re.sub(r"[.?]", " ", prompt.lower()).split())
    if not words:
        raise PromptError("The prompt is empty. Type what the object is, for example: vase.")
    return f"{words} ."


@dataclass(frozen=True)
class Tokens:
    """A caption for the model.

    Attributes
    ----------
    ids, attention : arrays of shape [1, L], int64
        ``attention`` is 1 where a token is, 0 where padding is.
    words : tuple of str
        The text of each token, empty for special ones and padding.
    """

    ids: NDArray[np.int64]
    attention: NDArray[np.int64]
    words: tuple[str, ...]


class Tokenizer:
    """bert-base-uncased's, from its ``tokenizer.json``."""

    def __init__(self, path: Path) -> None:
        try:
            import tokenizers
        except ImportError as error:
            raise EnvironmentProblem(
                "The package tokenizers is not in the engine's environment. Set up the engine anew."
            ) from error
        try:
            self._tokenizer = tokenizers.Tokenizer.from_file(str(path))
        except Exception as error:  # tokenizers raises the bare Exception
            raise ModelFileError(
                f"The tokenizer file {path} cannot be read ({error}). Delete it and its record, then run: "
                "python -m engine models fetch grounding-dino-tokenizer"
            ) from error
        self._tokenizer.no_truncation()
        self._tokenizer.no_padding()

    def __call__(self, text: str, length: int | None) -> Tokens:
        """Return the tokens of `text`, padded to `length` where the export has a fixed one.

        Raises
        ------
        PromptError
            When the text is too long.
        """
        encoded = self._tokenizer.encode(text)
        ids, special = list(encoded.ids), list(encoded.special_tokens_mask)
        most = min(length or MAX_TOKENS, MAX_TOKENS)
        if len(ids) > most:
            raise PromptError(f"The prompt has {len(ids)} word pieces, {most} at most are read. Use fewer words.")
        padding = (length or len(ids)) - len(ids)
        attention = [1] * len(ids) + [0] * padding
        words = ["" if mark else token for token, mark in zip(encoded.tokens, special, strict=True)]
        return Tokens(
            np.array([ids + [0] * padding], np.int64), np.array([attention], np.int64), (*words, *[""] * padding)
        )


def load_tokenizer(path: Path) -> Tokenizer:
    """Return the tokenizer in the file `path`.

    Raises
    ------
    ModelFileError
        When it is missing or damaged.
    EnvironmentProblem
        When the package ``tokenizers`` is missing.
    """
    return Tokenizer(path)


def resized_size(height: int, width: int, shortest: int = _SHORTEST, longest: int = _LONGEST) -> tuple[int, int]:
    """Return height and width of a photo whose shorter side becomes `shortest`, the longer one at most `longest`.

    Decimals are cut off or rounded as the model's own preprocessing does, so that its grid of features is the same.
    """
    small, large = min(height, width), max(height, width)
    exact = float(shortest)
    if large / small * shortest > longest:
        exact = longest * small / large
    rounded = round(exact)
    other = max(1, int((exact if exact != shortest else rounded) * large / small))
    if rounded == small:
        return height, width
    return (rounded, other) if height <= width else (other, rounded)


def picture(pixels: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.float32]:
    """Return a photo as the model's input, shape [1, 3, h, w], float32.

    Parameters
    ----------
    pixels : array of shape [H, W, 3], uint8, sRGB
    size : (int, int)
        h, w. Any shape will do: boxes come back as fractions of the photo.
    """
    from PIL import Image

    height, width = size
    # Pillow's bilinear filter widens when shrinking, which is what the model was trained with.
    resized = np.asarray(Image.fromarray(pixels).resize((width, height), Image.Resampling.BILINEAR), np.float32)
    normalised = (resized * np.float32(1 / 255) - _MEAN) / _DEVIATION
    return np.ascontiguousarray(normalised.transpose(2, 0, 1)[None], np.float32)
