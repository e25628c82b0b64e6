"""Weight files: which there are, where they lie, how they are fetched and opened."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .catalogue import CATALOGUE, ModelFile, fetch, find, find_together, locate, models_folder
    from .onnx_session import open_session
    from .packages import holds

__all__ = [
    "CATALOGUE",
    "ModelFile",
    "fetch",
    "find",
    "find_together",
    "holds",
    "locate",
    "models_folder",
    "open_session",
]

__getattr__ = lazy_exports(__name__, __file__)
