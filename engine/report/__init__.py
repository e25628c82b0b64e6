"""The HTML report of a finished project."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .build import build_report
    from .plots import compare_curves

__all__ = ["build_report", "compare_curves"]

__getattr__ = lazy_exports(__name__, __file__)
