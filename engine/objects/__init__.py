"""Objects of a trained scene: from a prompt (text, click, box or mask) to a membership per Gaussian."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .candidate_file import CANDIDATES, forget_candidates
    from .context import SegmentationContext, label_maps_of, load_context, photo_folder_of, scene_on
    from .curation import (
        TextResult,
        accept_candidate,
        choose_level,
        refine_object,
        segment_each_text,
        segment_texts,
        store_background,
    )
    from .everything import find_everything, segment_everything_in
    from .evidence import DetectorFactory
    from .found import NoMatchError
    from .graph import SceneGraph
    from .photos import Photos, SamFactory
    from .polishing import polish
    from .prompts import ClickPrompt, MaskPrompt, Prompt, TextPrompt, parse_point, parse_prompt, parse_texts
    from .segment import find_objects, mask_at, segment_project
    from .storage import (
        forget_unreadable_record,
        is_object_intact,
        list_objects,
        load_membership,
        load_object,
        object_gaussians,
        object_ids,
        save_object,
        taken_ids,
    )
    from .trash import TrashEntry, delete_object, discard_object, empty_trash, keep_version, list_trash, restore_object
    from .views import View, Views, erode_mask, spread_cameras
    from .votes import THRESHOLD

__all__ = [
    "CANDIDATES",
    "THRESHOLD",
    "ClickPrompt",
    "DetectorFactory",
    "MaskPrompt",
    "NoMatchError",
    "Photos",
    "Prompt",
    "SamFactory",
    "SceneGraph",
    "TextPrompt",
    "TextResult",
    "SegmentationContext",
    "TrashEntry",
    "View",
    "Views",
    "accept_candidate",
    "choose_level",
    "delete_object",
    "discard_object",
    "empty_trash",
    "erode_mask",
    "find_everything",
    "find_objects",
    "forget_candidates",
    "forget_unreadable_record",
    "is_object_intact",
    "keep_version",
    "label_maps_of",
    "list_objects",
    "list_trash",
    "load_membership",
    "load_object",
    "load_context",
    "mask_at",
    "object_gaussians",
    "object_ids",
    "parse_point",
    "parse_prompt",
    "parse_texts",
    "photo_folder_of",
    "scene_on",
    "polish",
    "refine_object",
    "restore_object",
    "save_object",
    "segment_each_text",
    "segment_everything_in",
    "segment_project",
    "segment_texts",
    "spread_cameras",
    "store_background",
    "taken_ids",
]

__getattr__ = lazy_exports(__name__, __file__)
