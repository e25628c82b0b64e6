"""The encoder of Segment Anything on what computes it fastest, if that computes what ONNX Runtime does on the CPU."""

from __future__ import annotations

import functools
import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.child_process import ChildFailure, run_in_child
from ..core.errors import HeritageError
from ..install.models import gpu_provider_is_installed, locate, open_gpu_session, open_session, read_onnx_weights
from .settings import SAM_MODELS

if TYPE_CHECKING:
    from .torch_encoder import TorchEncoder

_LOG = logging.getLogger(__name__)

# Largest difference from the CPU, as a share of the largest value. Embeddings are stored in half precision, which
# rounds by up to 5e-4 of a value and does not change masks (docs/design_notes/masks.md). Sums in another order should
# differ by about 1e-5; a wrong kernel, or half precision inside of the network, by 1e-2 and more.
_MAX_DIFFERENCE = 2e-3
# The same for bfloat16, whose products round by 4e-3 of a value: photos differ by 0.01, wrong weights by 1.
_MAX_BFLOAT16_DIFFERENCE = 0.05
_INPUT_SIDE = 1024
_CARD_SECONDS = 60.0
"""For the encoding of a photo on the graphics card, which takes one or two."""
_CARD_BYTES = 1 << 46
"""Address space for it: drivers reserve much more than they use."""


class PhotoEncoder:
    """The encoder of Segment Anything on a graphics card that passes a self-test, or else on the CPU.

    On a processor that multiplies bfloat16, torch computes the encoder of MobileSAM in it, if the features of the first
    photo agree with the features of ONNX Runtime, which computes all others.

    Parameters
    ----------
    path : Path
        ONNX file.
    threads : int
        Worker threads of ONNX Runtime.
    may_use_gpu : bool
        False does not look for a graphics card.

    Attributes
    ----------
    on_card : bool
        Whether a graphics card encodes photos.
    takes_photo : bool
        Whether it takes a resized photo, [H, W, 3], instead of the normalised, padded square, [1, 3, 1024, 1024].

    Raises
    ------
    ModelFileError
        When the file is missing or is not an ONNX model.
    """

    def __init__(self, path: Path, *, threads: int, may_use_gpu: bool) -> None:
        self._path = path
        self._session = open_session(path, threads=threads)
        node = self._session.get_inputs()[0]
        self._input, self.takes_photo = node.name, len(node.shape) == 3
        self._was_checked = False
        gpu, self._description = open_gpu_session(path) if may_use_gpu else (None, "nothing else was asked for")
        problem = None if gpu is None else _failed_self_test(self._session, gpu)
        self.on_card = gpu is not None and problem is None
        if problem is not None:
            self._description += f" failed the self-test: {problem}"
            _LOG.warning("Photos are encoded on the CPU: %s.", self._description)
        if self.on_card:
            self._session = gpu
            _LOG.info(self.device)

    @property
    def device(self) -> str:
        """The device that encodes photos and the reason, as a sentence."""
        if self.on_card:
            return f"Photos are encoded on the graphics card with {self._description}; it passed the self-test."
        precision = "" if self._torch is None else " in bfloat16"
        return f"Photos are encoded on the CPU{precision}: {self._description}."

    def encode(self, picture: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the features, float32 [1, c, 64, 64], of the input that `takes_photo` describes."""
        if self._torch is not None:
            found = self._torch.encode(picture)
            if self._was_checked:
                return found
            self._was_checked = True
            expected = self._run(picture)
            difference = _difference(found, expected)
            if difference <= _MAX_BFLOAT16_DIFFERENCE:
                return found
            _LOG.warning("Photos are encoded in float32: in bfloat16, features differ by %.1g.", difference)
            self._torch = None
            return expected
        return self._run(picture)

    def _run(self, picture: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(self._session.run(None, {self._input: picture})[0], np.float32)

    @functools.cached_property
    def _torch(self) -> TorchEncoder | None:
        """The same network in bfloat16; None where that is no faster, and for files of another structure."""
        if self.on_card or self.takes_photo:
            return None
        from ..install.models import multiplies_bfloat16  # torch takes a second to import
        from .torch_encoder import TorchEncoder

        if not multiplies_bfloat16():
            return None
        try:
            return TorchEncoder(read_onnx_weights(self._path), bfloat16=True)
        except (HeritageError, KeyError, IndexError, ValueError) as error:
            _LOG.info("%s is computed by onnxruntime, it has another structure: %s", self._path.name, error)
            return None


def describe_encoding() -> tuple[bool, str]:
    """Return whether a graphics card encodes photos with the default model, and a sentence about it."""
    try:
        encoder = PhotoEncoder(locate(f"{SAM_MODELS[0]}-encoder"), threads=2, may_use_gpu=True)
    except HeritageError as error:
        return False, str(error)
    return encoder.on_card, encoder.device


def card_encodes() -> tuple[bool, str]:
    """Return the result of `describe_encoding` in a process of its own, which a driver may crash or hang."""
    if not gpu_provider_is_installed():
        return describe_encoding()
    try:
        usable, sentence = run_in_child(
            "masks.encoder:describe_encoding", {}, max_memory=_CARD_BYTES, max_seconds=_CARD_SECONDS,
            what="encoding a photo on the graphics card",
        )  # fmt: skip
    except ChildFailure as failure:
        return False, f"Photos are encoded on the CPU: {str(failure).rstrip('.')}; update its driver."
    return usable, sentence


def _failed_self_test(cpu: Any, gpu: Any) -> str | None:
    """Return why results of a card cannot be used; None when they can."""
    node = cpu.get_inputs()[0]
    picture = _test_picture()
    given = {node.name: picture if len(node.shape) == 3 else picture.transpose(2, 0, 1)[None] / 64.0 - 2.0}
    expected = np.asarray(cpu.run(None, given)[0])
    try:
        found = np.asarray(gpu.run(None, given)[0])
    except Exception as error:  # drivers raise anything
        return (str(error).splitlines() or ["unknown"])[0].rstrip(".")
    if found.shape != expected.shape or not np.isfinite(found).all():
        return "its features are not finite or have another shape"
    difference = _difference(found, expected)
    if difference > _MAX_DIFFERENCE:
        return f"its features differ from those of the CPU by {difference:.1g}, {_MAX_DIFFERENCE:g} are allowed"
    return None


def _difference(found: NDArray[np.float32], expected: NDArray[np.float32]) -> float:
    """Return the largest difference of features as a share of the largest one."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def _test_picture() -> NDArray[np.float32]:
    """Return squares of several sizes and grey levels with noise, float32 [1024, 1024, 3], 0 to 255."""
    generator = np.random.default_rng(0)
    picture = np.zeros((_INPUT_SIDE, _INPUT_SIDE, 3), np.float32)
    for cell in (8, 64, 256):
        small = generator.uniform(0.0, 85.0, (_INPUT_SIDE // cell, _INPUT_SIDE // cell, 3)).astype(np.float32)
        picture += small.repeat(cell, axis=0).repeat(cell, axis=1)
    return picture
