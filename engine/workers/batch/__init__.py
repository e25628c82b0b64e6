"""Many photo folders on the workers of a Dask cluster, one task per stage. Imported only by `commands`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .coordinator import BatchResult, run_batch
    from .folder_state import FolderState
    from .remote_job import run_remote_job
    from .settings import BatchSettings
    from .summary import summary_as_dict, summary_page, summary_text

__getattr__ = lazy_exports(__name__, __file__)
