"""The encoder of Segment Anything on a graphics card, if one computes what the CPU computes."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..child_process import ChildFailure, run_in_child
from ..errors import HeritageError
from ..models import gpu_provider_is_installed, locate, open_gpu_session, open_session
from .settings import SAM_MODELS

__all__ = ["card_encodes", "describe_encoding", "open_encoder"]

_LOG = logging.getLogger(__name__)

# Largest difference from the CPU, as a share of the largest value. Embeddings are stored in half precision, which
# rounds by up to 5e-4 of a value and does not change masks (docs/design_notes/masks.md). Sums in another order should
# differ by about 1e-5; a wrong kernel, or half precision inside of the network, by 1e-2 and more.
_MAX_DIFFERENCE = 2e-3
_INPUT_SIDE = 1024
_CARD_SECONDS = 60.0
"""For the encoding of a photo on the graphics card, which takes one or two."""
_CARD_BYTES = 1 << 46
"""Address space for it: drivers reserve much more than they use."""


def open_encoder(path: Path, *, threads: int, may_use_gpu: bool) -> tuple[Any, str]:
    """Return an `onnxruntime.InferenceSession` of the encoder, and a sentence about what it runs on.

    Parameters
    ----------
    path : Path
        ONNX file.
    threads : int
        Worker threads on the CPU.
    may_use_gpu : bool
        False does not look for a graphics card.

    Raises
    ------
    ModelFileError
        When the file is missing or is not an ONNX model.
    """
    cpu = open_session(path, threads=threads)
    gpu, description = open_gpu_session(path) if may_use_gpu else (None, "nothing else was asked for")
    if gpu is not None:
        problem = _failed_self_test(cpu, gpu)
        if problem is None:
            sentence = f"Photos are encoded on the graphics card with {description}; it passed the self-test."
            _LOG.info(sentence)
            return gpu, sentence
        description = f"{description} failed the self-test: {problem}"
        _LOG.warning("Photos are encoded on the CPU: %s.", description)
    return cpu, f"Photos are encoded on the CPU: {description}."


def describe_encoding() -> tuple[bool, str]:
    """Return whether a graphics card encodes photos with the default model, and a sentence about it."""
    try:
        session, sentence = open_encoder(locate(f"{SAM_MODELS[0]}-encoder"), threads=2, may_use_gpu=True)
    except HeritageError as error:
        return False, str(error)
    return session.get_providers()[0] != "CPUExecutionProvider", sentence


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
    difference = float(np.abs(found - expected).max() / np.abs(expected).max())
    if difference > _MAX_DIFFERENCE:
        return f"its features differ from those of the CPU by {difference:.1g}, {_MAX_DIFFERENCE:g} are allowed"
    return None


def _test_picture() -> NDArray[np.float32]:
    """Return squares of several sizes and grey levels with noise, float32 [1024, 1024, 3], 0 to 255."""
    generator = np.random.default_rng(0)
    picture = np.zeros((_INPUT_SIDE, _INPUT_SIDE, 3), np.float32)
    for cell in (8, 64, 256):
        small = generator.uniform(0.0, 85.0, (_INPUT_SIDE // cell, _INPUT_SIDE // cell, 3)).astype(np.float32)
        picture += small.repeat(cell, axis=0).repeat(cell, axis=1)
    return picture
