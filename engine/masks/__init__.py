"""Segment Anything on photos: one int32 label map per photo, and masks for clicks and boxes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .beside import MasksBeside, make_masks_with_helpers, sam_threads
    from .embeddings import EmbeddingFolder
    from .encoder import card_encodes
    from .foreground import make_foreground_masks
    from .mask_geometry import box_ious, mask_box, mask_iou, suppress_overlapping
    from .mask_metrics import boundary_iou, feature_agreement, halo, holes, iou, stray
    from .sam import Embedding, SegmentAnything, load_default_sam, load_sam
    from .stage import make_masks
    from .storage import label_map_path, read_label_map

__getattr__ = lazy_exports(__name__, __file__)
