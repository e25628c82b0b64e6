"""Image-text encoders (CLIP, SigLIP 2) in onnxruntime: unit vectors of pictures and of texts.

The inputs are those of the public descriptions: `preprocessor_config.json` and `tokenizer.json` of the exports.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ...core.arrays import Float32, Int64, Pixels, normalized
from ...core.errors import ModelFileError, PromptError
from ...install.models import Session, find_model_files, locate, open_session
from .tokenizer_file import open_tokenizer


@dataclass(frozen=True)
class EncoderKind:
    """Inputs and outputs of an encoder, from its public description.

    Attributes
    ----------
    side : int
        Pixels of a picture, which is square.
    filter : str
        With which pictures are resized, widened where they become smaller.
    mean, deviation : tuple of 3 float
        Of red, green and blue, 0 to 1.
    n_tokens : int
        Most tokens of a text.
    padding : int or None
        Id that fills texts up to `n_tokens`; None pads to the longest text of a batch, with the token that ends a text.
    picture_output, text_output : str
        Outputs with the vectors.
    phrasings : tuple of str
        The vector of a word is the mean over them.
    knows_languages : bool
        Whether it was trained on texts of many languages.
    """

    side: int
    filter: Literal["bicubic", "bilinear"]
    mean: tuple[float, float, float]
    deviation: tuple[float, float, float]
    n_tokens: int
    padding: int | None
    picture_output: str
    text_output: str
    phrasings: tuple[str, ...]
    knows_languages: bool = False


_CLIP = EncoderKind(
    side=224,
    filter="bicubic",
    mean=(0.48145466, 0.4578275, 0.40821073),
    deviation=(0.26862954, 0.26130258, 0.27577711),
    n_tokens=77,
    padding=None,
    picture_output="image_embeds",
    text_output="text_embeds",
    # Of the 80 phrasings that were published with CLIP, those that fit photos of things and of works of art.
    phrasings=("a photo of a {}.", "a rendering of a {}.", "art of the {}."),
)
_SIGLIP_2 = EncoderKind(
    side=256,
    filter="bilinear",
    mean=(0.5, 0.5, 0.5),
    deviation=(0.5, 0.5, 0.5),
    n_tokens=64,
    padding=0,
    picture_output="pooler_output",
    text_output="pooler_output",
    # The published one. A text costs as much as a picture here, because it always has 64 tokens.
    phrasings=("This is a photo of {}.",),
    knows_languages=True,
)
ENCODERS: dict[str, EncoderKind] = {
    "siglip-2-base": _SIGLIP_2,
    "clip-vit-b-16": _CLIP,
    "clip-vit-b-32-fp16": _CLIP,
    "clip-vit-b-32": _CLIP,
}
"""Encoders of the catalogue, in order of preference where several are stored."""

_BATCH = {"picture": 8, "text": 32}


class Tower:
    """One half of an encoder: a session with one input that has data, and one output with vectors.

    Raises
    ------
    ModelFileError
        When the session is that of another model.
    """

    def __init__(self, name: str, session: Session, given: str, wanted: str) -> None:
        self._session, self._given, self._wanted = session, given, wanted
        inputs = {node.name: node for node in session.get_inputs()}
        outputs = {node.name: node for node in session.get_outputs()}
        if given not in inputs or not set(inputs) <= {given, "attention_mask"}:
            raise ModelFileError(
                f"{name} has the inputs {', '.join(inputs)} and needs {given}: it is not this part of an image-text "
                "encoder. Fetch it again."
            )
        if wanted not in outputs:
            raise ModelFileError(
                f"{name} has the outputs {', '.join(outputs)} and needs {wanted}: it is not this part of an image-text "
                "encoder. Fetch it again."
            )
        self._has_mask = "attention_mask" in inputs
        self._half = inputs[given].type == "tensor(float16)"
        self.shape = list(inputs[given].shape)
        width = outputs[wanted].shape[-1]
        self.width = width if isinstance(width, int) else None

    def run(self, rows: Float32 | Int64) -> Float32:
        """Return one unit vector per row."""
        inputs: dict[str, Any] = {self._given: rows.astype(np.float16) if self._half else rows}
        if self._has_mask:
            inputs["attention_mask"] = np.ones(rows.shape, np.int64)
        (found,) = self._session.run([self._wanted], inputs)
        return normalized(np.asarray(found, np.float32).reshape(len(rows), -1))


class ImageTextEncoder:
    """Unit vectors of pictures and of texts, whose cosine tells how well they fit.

    Parameters
    ----------
    name : str
        For messages.
    pictures, texts : Session
        Open sessions.
    tokenizer : Path
        The ``tokenizer.json`` of the export.

    Raises
    ------
    ModelFileError
        When a session is that of another model, or the tokenizer file cannot be read.
    EnvironmentProblem
        When the package ``tokenizers`` is missing.

    References
    ----------
    Radford et al., "Learning Transferable Visual Models From Natural Language Supervision", 2021.
    Tschannen et al., "SigLIP 2: Multilingual Vision-Language Encoders", 2025.
    """

    def __init__(self, name: str, kind: EncoderKind, pictures: Session, texts: Session, tokenizer: Path) -> None:
        self.name, self.kind = name, kind
        self._pictures = Tower(f"{name}-vision", pictures, "pixel_values", kind.picture_output)
        self._texts = Tower(f"{name}-text", texts, "input_ids", kind.text_output)
        side = self._pictures.shape[-1]
        if isinstance(side, int) and side != kind.side:
            raise ModelFileError(
                f"{name}-vision takes pictures of {side} pixels instead of {kind.side}: it is another encoder. Fetch "
                "it again."
            )
        widths = (self._pictures.width, self._texts.width)
        if None not in widths and widths[0] != widths[1]:
            raise ModelFileError(
                f"{name}-vision gives {widths[0]} numbers and {name}-text {widths[1]}: they do not belong together. "
                "Fetch both again."
            )
        self._tokenizer = open_tokenizer(tokenizer, name)

    @property
    def fingerprint(self) -> str:
        """Names what `of_words` computes; the catalogue pins the hashes of the files of this name."""
        return f"{self.name} {' '.join(self.kind.phrasings)}"

    def of_pictures(self, pictures: Sequence[Pixels]) -> Float32:
        """Return one unit vector per square picture, [n, D].

        Parameters
        ----------
        pictures : sequence of arrays of shape [side, side, 3], uint8, sRGB
            Of any side.
        """
        size = _BATCH["picture"]
        batches = [pictures[start : start + size] for start in range(0, len(pictures), size)]
        inputs = (np.stack([self.input_of(picture) for picture in batch]) for batch in batches)
        return np.concatenate([self._pictures.run(rows) for rows in inputs])

    def of_texts(self, texts: Sequence[str]) -> Float32:
        """Return one unit vector per text, [n, D].

        Raises
        ------
        PromptError
            When a text is too long.
        """
        size = _BATCH["text"]
        batches = [texts[start : start + size] for start in range(0, len(texts), size)]
        return np.concatenate([self._texts.run(self.tokens_of(batch)) for batch in batches])

    def of_words(self, words: Sequence[str]) -> Float32:
        """Return one unit vector per word: the mean over the phrasings, [n, D].

        Raises
        ------
        PromptError
            When a word is too long.
        """
        phrasings = self.kind.phrasings
        vectors = self.of_texts([phrasing.format(word) for word in words for phrasing in phrasings])
        return normalized(vectors.reshape(len(words), len(phrasings), -1).mean(axis=1))

    def input_of(self, picture: Pixels) -> Float32:
        """Return a square picture as the model's input, [3, side, side]."""
        from PIL import Image

        kind = self.kind
        # Pillow's filters are widened when a picture is reduced; the models were trained with them.
        resampling = Image.Resampling.BICUBIC if kind.filter == "bicubic" else Image.Resampling.BILINEAR
        resized = np.asarray(Image.fromarray(picture).resize((kind.side, kind.side), resampling), np.float32)
        mean, deviation = np.array(kind.mean, np.float32), np.array(kind.deviation, np.float32)
        return np.ascontiguousarray(((resized * np.float32(1 / 255) - mean) / deviation).transpose(2, 0, 1))

    def tokens_of(self, texts: Sequence[str]) -> Int64:
        """Return the tokens of texts, [n, L].

        Raises
        ------
        PromptError
            When a text is too long.
        """
        kind = self.kind
        # CLIP's tokenizer file turns texts into lower case, SigLIP 2's does not.
        encodings = self._tokenizer.encode_batch([text.lower() for text in texts])
        ids = [list(encoding.ids) for encoding in encodings]
        longest = max(map(len, ids))
        if longest > kind.n_tokens:
            raise PromptError(
                f"The prompt has {longest} word pieces; {self.name} reads at most {kind.n_tokens}. Use fewer words."
            )
        fixed = self._texts.shape[-1]
        length = fixed if isinstance(fixed, int) else longest if kind.padding is None else kind.n_tokens
        # The vector is that of the first token that ends a text, which sees none behind it.
        fill = [one[-1] if kind.padding is None else kind.padding for one in ids]
        return np.array([[*one, *[end] * (length - len(one))] for one, end in zip(ids, fill, strict=True)], np.int64)


def load_encoder(name: str, cache: Path | None = None) -> ImageTextEncoder:
    """Return an encoder of the catalogue, from its files in the models folder.

    Parameters
    ----------
    name : str
        One of `ENCODERS`.
    cache : Path or None
        See `models.models_folder`.

    Raises
    ------
    ModelFileError
        When a file is missing, damaged or that of another model.
    EnvironmentProblem
        When a package is missing.
    """
    vision, text, tokenizer = (locate(file.name, cache) for file in find_model_files(name))
    pictures, texts = (open_session(file) for file in (vision, text))
    return ImageTextEncoder(name, ENCODERS[name], pictures, texts, tokenizer)
