"""Training presets compared on the same cameras: error against run time, as a table and curves."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .comparison import compare, savings
    from .table import markdown, write_comparison

__getattr__ = lazy_exports(__name__, __file__)
