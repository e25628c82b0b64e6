"""Metrics of objects against ground-truth masks, and the tables in `docs/`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .document import write_section
    from .ground_truth import read_ground_truth
    from .isolation import evaluate_project, mean_of, visible_masks
    from .mask_metrics import feature_agreement, iou
    from .table import INTRODUCTION, MEANINGS, markdown, write_evaluation

__all__ = [
    "INTRODUCTION",
    "MEANINGS",
    "evaluate_project",
    "feature_agreement",
    "iou",
    "markdown",
    "mean_of",
    "read_ground_truth",
    "visible_masks",
    "write_evaluation",
    "write_section",
]

__getattr__ = lazy_exports(__name__, __file__)
