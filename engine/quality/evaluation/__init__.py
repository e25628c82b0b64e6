"""Metrics of objects against ground-truth masks, and the tables in `docs/`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .document import write_section
    from .ground_truth import GroundTruth, read_ground_truth
    from .isolation import evaluate_project
    from .outlines import evaluate_outlines, outline_table
    from .results import mean_of
    from .results_file import write_results
    from .table import INTRODUCTION, MEANINGS, markdown, write_evaluation

__getattr__ = lazy_exports(__name__, __file__)
