"""The HTML report of a finished project."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .build import build_report
    from .markup import Html, fill, joined
    from .plots import compare_curves
    from .sheet import PAPER_WHITE, picture_sheet, render_alone
    from .style import STYLE
    from .views import best_seen_from, orbit_cameras

__getattr__ = lazy_exports(__name__, __file__)
