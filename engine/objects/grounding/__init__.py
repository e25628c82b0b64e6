"""Text grounding: find the boxes or segments of a photo that a text describes, with scores."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .default import WORD_MODELS, load_default_detector, load_detector, offered_model, stored_describers
    from .detector import Detector, PromptCheck

__getattr__ = lazy_exports(__name__, __file__)
