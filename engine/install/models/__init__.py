"""Weight files of the models: their catalogue, the folder they are stored in, how to fetch and open them, and how
torch uses the processor."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .cache import locate, models_folder
    from .catalogue import ANY_WORD_MODEL, CATALOGUE, ModelFile, find_model_file, find_model_files
    from .fetching import fetch, fetch_model
    from .onnx_session import Session, gpu_provider_is_installed, open_gpu_session, open_session
    from .onnx_weights import read_onnx_weights
    from .packages import folder_contains
    from .processor import multiplies_bfloat16, one_thread

__getattr__ = lazy_exports(__name__, __file__)
