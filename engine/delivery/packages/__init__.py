"""Files that leave a project to be kept or shown: packages with their records, a page, pictures that turn."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .exporting import (
        Export,
        divided,
        load_export,
        mesh_of,
        mesh_sentence,
        turn_of,
        write_export,
        write_mesh_export,
    )
    from .package import write_package
    from .page import is_viewer_built
    from .turntable import FILMS, SHEET, Turn, write_films, write_sheet
    from .verification import verify_package

__getattr__ = lazy_exports(__name__, __file__)
