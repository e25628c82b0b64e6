"""Numerical stability in stiff and extreme cases: float32 compared with float64, and whole training runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .table import run_cases, select_cases, suite_markdown, write_table

__getattr__ = lazy_exports(__name__, __file__)
