"""The mask decoder of Segment Anything from an ONNX file: in torch where the file has the usual structure."""

from __future__ import annotations

import functools
import logging
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..core.errors import HeritageError, ModelFileError
from ..install.models import open_session, read_onnx_weights

if TYPE_CHECKING:
    from .torch_decoder import TorchDecoder

_LOG = logging.getLogger(__name__)

_INPUTS = {"image_embeddings", "point_coords", "point_labels", "mask_input", "has_mask_input", "orig_im_size"}
_LOW_RES_SIDE = 256
# Largest difference of the two decoders' logits and IoUs, as a share of the largest logit. Rounding makes 1e-6, and a
# file with another network makes differences of the size of the logits.
_MAX_DIFFERENCE = 1e-3
# The same for bfloat16: clicks differ by 0.01 to 0.04.
_MAX_BFLOAT16_DIFFERENCE = 0.15

Masks = tuple[NDArray[np.float32], NDArray[np.float32]]
"""Logits [k, 256, 256] and predicted IoUs [k]."""


class MaskDecoder:
    """Decoder with Meta's ONNX interface.

    Exports with one mask per prompt are computed by `TorchDecoder`, which needs less CPU time, if it agrees
    with ONNX Runtime on the first prompt. ONNX Runtime computes other exports and prompts with a mask. Masks that may
    be approximated are computed in bfloat16 on processors that multiply it.

    Parameters
    ----------
    threads : int
        Worker threads of ONNX Runtime.

    Raises
    ------
    ModelFileError
        When the file is missing, damaged or has different inputs.
    """

    def __init__(self, path: Path, *, threads: int) -> None:
        self._path = path
        self._session = open_session(path, threads=threads)
        if {node.name for node in self._session.get_inputs()} != _INPUTS:
            raise ModelFileError(f"{path} is not a SAM mask decoder. Run: python -m engine models fetch")
        self._was_checked = self._bfloat16_was_checked = False
        # The decoder in torch keeps what it computed of the picture.
        self._lock = threading.Lock()

    def decode(
        self,
        features: NDArray[np.float32],
        coordinates: NDArray[np.float32],
        labels: NDArray[np.float32],
        cells: tuple[int, int] | None = None,
        min_stability: float = 0.0,
    ) -> Masks:
        """Return the masks of a prompt.

        Parameters
        ----------
        features : array of shape [1, 256, 64, 64], float32
        coordinates : array of shape [1, n, 2], float32
            x, y in pixels of the encoder's frame.
        labels : array of shape [1, n], float32
        cells : (int, int) or None
            Rows and columns of cells to look at, where the rest may be left out.
        min_stability : float
            With `cells`, masks that are clearly less stable may be left coarse.

        Returns
        -------
        logits : array of shape [k, 256, 256], float32
            k is 1 or 4.
        ious : array of shape [k], float32

        Raises
        ------
        ModelFileError
            When the decoder returns another number of masks.
        """
        with self._lock:
            if self._torch is None:
                return self._run(features, coordinates, labels)
            if not self._was_checked:
                self._was_checked = True
                expected = self._run(features, coordinates, labels)
                if not _agree(self._torch.decode(features, coordinates, labels), expected, _MAX_DIFFERENCE):
                    _LOG.warning("%s is decoded by onnxruntime: torch computes other masks", self._path.name)
                    self._torch = None
                    return expected
            if cells is None or self._bfloat16 is None:
                return self._torch.decode(features, coordinates, labels, cells, min_stability)
            if not self._bfloat16_was_checked:
                self._bfloat16_was_checked = True
                found, expected = (
                    decoder.decode(features, coordinates, labels) for decoder in (self._bfloat16, self._torch)
                )
                if not _agree(found, expected, _MAX_BFLOAT16_DIFFERENCE):
                    _LOG.warning("%s is decoded in float32: in bfloat16, masks differ", self._path.name)
                    self._bfloat16 = None
                    return self._torch.decode(features, coordinates, labels, cells, min_stability)
            return self._bfloat16.decode(features, coordinates, labels, cells, min_stability)

    @functools.cached_property
    def _bfloat16(self) -> TorchDecoder | None:
        """The network of `_torch` in bfloat16, for what may be approximated; None where that is no faster."""
        from ..install.models import multiplies_bfloat16
        from .torch_decoder import TorchDecoder

        return TorchDecoder(read_onnx_weights(self._path), bfloat16=True) if multiplies_bfloat16() else None

    @functools.cached_property
    def _torch(self) -> TorchDecoder | None:
        """The same network in torch; None for files of another structure."""
        from .torch_decoder import TorchDecoder  # torch takes a second to import

        shapes = {node.name: node.shape for node in self._session.get_outputs()}
        if shapes["low_res_masks"][1] != 1:
            return None
        try:
            return TorchDecoder(read_onnx_weights(self._path))
        except (HeritageError, KeyError, IndexError, ValueError) as error:
            _LOG.info("%s is decoded by onnxruntime, it has another structure: %s", self._path.name, error)
            return None

    def _run(
        self,
        features: NDArray[np.float32],
        coordinates: NDArray[np.float32],
        labels: NDArray[np.float32],
    ) -> Masks:
        iou, logits = self._session.run(
            ["iou_predictions", "low_res_masks"],
            {
                "image_embeddings": features,
                "point_coords": coordinates,
                "point_labels": labels,
                # No prompt is a mask.
                "mask_input": np.zeros((1, 1, _LOW_RES_SIDE, _LOW_RES_SIDE), np.float32),
                "has_mask_input": np.zeros(1, np.float32),
                # The decoder's enlarged masks are not used; a small size keeps them cheap.
                "orig_im_size": np.array([_LOW_RES_SIDE, _LOW_RES_SIDE], np.float32),
            },
        )
        masks, ious = np.asarray(logits, np.float32)[0], np.asarray(iou, np.float32)[0]
        if len(ious) not in (1, 4):
            raise ModelFileError(
                f"This SAM decoder returns {len(ious)} masks per prompt; supported are 1 and 4. Choose another export."
            )
        return masks, ious


def _agree(first: Masks, second: Masks, max_difference: float) -> bool:
    largest = float(np.abs(second[0]).max())
    difference = max(float(np.abs(first[0] - second[0]).max()) / largest, float(np.abs(first[1] - second[1]).max()))
    return difference <= max_difference
