"""Objects of a trained scene: from a prompt (text, click, box or mask) to a membership per Gaussian."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .candidate_file import CANDIDATES, cut_out, forget_candidates
    from .clicked import click_masks
    from .context import DetectorFactory, SegmentationContext, label_maps_of, load_context, photo_folder_of, scene_on
    from .detail import DetailResult, detail_object
    from .detail_cutter import DetailPhotos, read_part
    from .graph import SceneGraph
    from .looks import Looks
    from .photos import Photos, SamFactory
    from .prompts import ClickPrompt, MaskPrompt, Point, Prompt, TextPrompt, parse_point, parse_prompt
    from .segment import NoMatchError, find_everything, find_objects, mask_at
    from .segmenter import Segmenter
    from .views import View, Views, erode_mask, spread_cameras

__getattr__ = lazy_exports(__name__, __file__)
