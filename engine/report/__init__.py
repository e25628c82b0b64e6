"""The HTML report of a finished project."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .build import build_report
    from .markup import Html, fill, joined
    from .plots import compare_curves
    from .style import STYLE

__all__ = ["STYLE", "Html", "build_report", "compare_curves", "fill", "joined"]

__getattr__ = lazy_exports(__name__, __file__)
