"""Settings of object segmentation, and their presets."""

from __future__ import annotations

from dataclasses import dataclass

from ..settings import require

__all__ = ["BETTER", "DEFAULT_PRESET", "PAPER", "PRESETS", "RELEASED", "PaperSettings", "SegmentSettings"]

_LEAST_SIDE = 16  # by definition
"""Smallest side of a picture in pixels."""


@dataclass(frozen=True)
class SegmentSettings:
    """Settings of the segmentation of one object by a prompt.

    The measurements behind the defaults are in docs/design_notes/objects.md.

    Attributes
    ----------
    n_text_views : int
        Number of photos, spread over the poses, in which a detector that describes no crops searches for a text.
    photo_side : int
        Longer side in pixels to which photos are reduced for the detector and SAM.
    render_side : int
        Longer side in pixels of the views that are rendered to read features and count votes.
    n_vote_views : int
        Largest number of photos whose segments take part in the graph of the scene (`engine.objects.graph`) and are
        proposals, and of views in which an object is polished.
    strictness : float
        Weight of a pixel beside an object relative to one inside of it (`SceneGraph.solve`), above 0. Smaller values
        give larger objects.
    same_object : float
        Two results are one object when their Gaussians overlap by more than this share, 0 to 1, of the smaller one.
    n_crop_views : int
        Largest number of photos that each proposal is cut out of.
    least_score : float
        When everything looks less than this like a text, 0 to 1, the text is not found.
    relative_score : float
        What scores, for one text, at least this share, 0 to 1, of the best score becomes an object.
    max_objects : int
        Largest number of objects for one text.
    polish_steps : int
        Training steps in which an object's Gaussians are polished alone (`engine.objects.polishing`) before it is
        stored. 0 keeps them as they are in the scene.
    """

    n_text_views: int = 12  # chosen on room_1, room_2, room_3, room_4, room_6, room_7
    photo_side: int = 1024  # by definition
    render_side: int = 480  # chosen on museum_room
    n_vote_views: int = 24  # chosen on museum_room
    strictness: float = 0.6  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
    same_object: float = 0.4  # chosen on museum_room
    n_crop_views: int = 4  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
    least_score: float = 0.5  # by definition
    relative_score: float = 0.85  # chosen on museum_room
    max_objects: int = 8  # by definition
    polish_steps: int = 200  # chosen on museum_room

    def __post_init__(self) -> None:
        for name in ("n_text_views", "n_vote_views", "n_crop_views", "max_objects"):
            require(self, name, getattr(self, name) >= 1, "at least 1")
        for name in ("photo_side", "render_side"):
            require(self, name, getattr(self, name) >= _LEAST_SIDE, f"at least {_LEAST_SIDE}")
        for name in ("least_score", "relative_score"):
            require(self, name, 0 <= getattr(self, name) <= 1, "between 0 and 1")
        require(self, "strictness", self.strictness > 0, "above 0")
        require(self, "same_object", 0 < self.same_object <= 1, "above 0 and at most 1")
        require(self, "polish_steps", self.polish_steps >= 0, "at least 0")


@dataclass(frozen=True)
class PaperSettings(SegmentSettings):
    """Settings of the published method (`engine.objects.paper`).

    Of the other settings it uses the sizes, `n_text_views`, `same_object`, `relative_score` and `max_objects`.

    Attributes
    ----------
    cosine : float
        Smallest cosine, between -1 and 1, of a Gaussian's feature with that of the mask.
    erode_pixels : int
        Pixels removed along the border of a mask before its feature is read, because features mix at silhouettes.
    outlier_iqr : float or None
        Gaussians farther than this many interquartile ranges from the quartiles on any axis are ignored for the convex
        hull (Gaussian Grouping: 1.0). None ignores none.
    """

    n_text_views: int = 8  # chosen on museum_room
    relative_score: float = 0.6  # chosen on museum_room
    polish_steps: int = 0  # by definition
    cosine: float = 0.7  # published: Dahaghin et al. 2024
    erode_pixels: int = 2  # chosen on museum_room
    outlier_iqr: float | None = 1.0  # published: Ye et al. 2024

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self, "cosine", -1.0 < self.cosine < 1.0, "between -1 and 1")
        require(self, "erode_pixels", self.erode_pixels >= 0, "at least 0")
        require(self, "outlier_iqr", self.outlier_iqr is None or self.outlier_iqr > 0, "above 0 or None")


BETTER = SegmentSettings()
"""One solve on the graph of the scene for each object."""

PAPER = PaperSettings()
"""Dahaghin et al. (2024): cosine 0.7 to the best-fitting mask of several views, then the convex hull."""

RELEASED = PaperSettings(n_text_views=1, erode_pixels=0, outlier_iqr=None)  # published: Dahaghin et al. 2024
"""The paper's released code, which differs from its text: one photo, and no outliers removed before the hull."""

PRESETS: dict[str, SegmentSettings] = {"paper": PAPER, "released": RELEASED, "better": BETTER}
DEFAULT_PRESET = "better"
