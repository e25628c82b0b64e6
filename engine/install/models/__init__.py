"""Weight files of the models: their catalogue, the folder they are stored in, and how to fetch and open them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .cache import locate, models_folder
    from .catalogue import CATALOGUE, ModelFile, find_model_file, find_model_files
    from .fetching import fetch
    from .onnx_session import gpu_provider_is_installed, open_gpu_session, open_session
    from .onnx_weights import read_onnx_weights
    from .packages import folder_contains

__all__ = [
    "CATALOGUE",
    "ModelFile",
    "fetch",
    "find_model_file",
    "find_model_files",
    "folder_contains",
    "gpu_provider_is_installed",
    "locate",
    "models_folder",
    "open_gpu_session",
    "open_session",
    "read_onnx_weights",
]

__getattr__ = lazy_exports(__name__, __file__)
