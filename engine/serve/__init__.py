"""The web server: photos uploaded from a browser, reconstructed here, objects out. Imported only by `commands`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .accounts import Accounts
    from .certificate import certificate_files
    from .health import check_server
    from .library import Library
    from .run import run_server
    from .settings import ServeSettings

__getattr__ = lazy_exports(__name__, __file__)
