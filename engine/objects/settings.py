"""Settings of object segmentation, and their presets."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..core.settings import require
from ..masks.settings import INSTANCE_COSINE

MEMBER_THRESHOLD = 0.5
"""Membership from which on a Gaussian belongs to a set, and to an object as it was isolated: as much speaks for it as
against it."""
DEFAULT_THRESHOLD = MEMBER_THRESHOLD
"""Where the slider of a new object starts: at the object as it was isolated."""


@dataclass(frozen=True)
class SegmentSettings:
    """Settings of the segmentation of one object by a prompt; docs/design_notes/objects.md tells what was measured.

    Attributes
    ----------
    n_text_views : int
        Photos, spread over the poses, in which a detector that describes no crops searches for a text.
    photo_side : int
        Longer side, in pixels, of the photos that detector and SAM get.
    render_side : int
        Longer side, in pixels, of the views in which features are read and votes are counted.
    n_vote_views : int
        Photos whose segments are in the graph of the scene (`engine.objects.graph`) and are proposals.
    strictness : float
        Weight of a pixel beside the object relative to one inside of it (`SceneGraph.solve`), above 0: smaller values
        give larger objects.
    n_crop_views : int
        Photos that each proposal is cut out of.
    least_score : float
        0 to 1. When everything looks less like a text, the text is not found.
    relative_score : float
        0 to 1. What scores at least this much of the best score is an object; of versions of an object with such
        scores, it is the likeliest whole one.
    max_objects : int
        Objects that one text names.
    detail_steps : int
        Training steps on the photos, at their own resolution, when detail is asked for an object
        (`engine.objects.detail`); 0 keeps it as it is in the scene.
    """

    n_text_views: int = 8  # chosen on museum_room
    photo_side: int = 1024
    render_side: int = 480  # chosen on museum_room
    n_vote_views: int = 24  # chosen on museum_room
    strictness: float = 0.6  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
    n_crop_views: int = 4  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
    least_score: float = 0.5
    relative_score: float = (
        0.92  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8, more_rooms, museum_room
    )
    max_objects: int = 8
    detail_steps: int = 1500  # chosen on museum_room

    def __post_init__(self) -> None:
        for name in ("n_text_views", "n_vote_views", "n_crop_views", "max_objects"):
            require(self, name, getattr(self, name) >= 1, "at least 1")
        for name in ("photo_side", "render_side"):
            require(self, name, getattr(self, name) >= 16, "at least 16")
        for name in ("least_score", "relative_score"):
            require(self, name, 0 <= getattr(self, name) <= 1, "between 0 and 1")
        require(self, "strictness", self.strictness > 0, "above 0")
        require(self, "detail_steps", self.detail_steps >= 0, "at least 0")


@dataclass(frozen=True, kw_only=True)
class PaperSettings(SegmentSettings):
    """Settings of the published method (`engine.objects.paper`).

    Of the other settings it uses the sizes, `n_text_views`, `relative_score` and `max_objects`.

    Attributes
    ----------
    cosine : float
        -1 to 1. A Gaussian belongs when its feature has at least this cosine with that of the mask.
    erode_pixels : int
        Pixels that are removed along the border of a mask before its feature is read: features mix at silhouettes.
    outlier_iqr : float or None
        Interquartile ranges from the quartiles, on any axis, beyond which a Gaussian is ignored for the convex hull
        (Gaussian Grouping: 1.0); None ignores none.
    """

    cosine: float
    erode_pixels: int
    outlier_iqr: float | None

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self, "cosine", -1.0 < self.cosine < 1.0, "between -1 and 1")
        require(self, "erode_pixels", self.erode_pixels >= 0, "at least 0")
        require(self, "outlier_iqr", self.outlier_iqr is None or self.outlier_iqr > 0, "above 0 or None")


BETTER = SegmentSettings()
"""One solve on the graph of the scene for each object."""

PAPER = PaperSettings(
    relative_score=0.6,  # chosen on museum_room
    detail_steps=0,
    cosine=INSTANCE_COSINE,
    erode_pixels=2,  # chosen on museum_room
    outlier_iqr=1.0,  # Ye et al. 2024
)
"""Dahaghin et al. (2024): the cosine to the best-fitting mask of several views, then the convex hull."""

RELEASED = replace(PAPER, n_text_views=1, erode_pixels=0, outlier_iqr=None)  # Dahaghin et al. 2024
"""The paper's released code, which differs from its text: one photo, and no outliers removed before the hull."""

PRESETS: dict[str, SegmentSettings] = {"paper": PAPER, "released": RELEASED, "better": BETTER}
DEFAULT_PRESET = "better"

SURE_SCORE = 0.6  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Confidence of a word's answer from which on things that are absent are refused too; below it, a name is a guess."""
