"""Numerical stability: float32 against float64 and whole trainings, in stiff and extreme cases."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .table import markdown, run_cases, select, write_table

__all__ = ["markdown", "run_cases", "select", "write_table"]

__getattr__ = lazy_exports(__name__, __file__)
