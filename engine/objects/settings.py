"""Settings of object segmentation, and their presets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from ..settings import require

__all__ = ["BETTER", "DEFAULT_PRESET", "PAPER", "PRESETS", "RELEASED", "SegmentSettings"]


@dataclass(frozen=True)
class SegmentSettings:
    """Settings of the segmentation of one object by a prompt.

    The measurements behind the defaults are in docs/design_notes/objects.md.

    Attributes
    ----------
    cosine : float
        Smallest cosine, between -1 and 1, of a Gaussian's or pixel's feature with a direction of the object at which it
        belongs to the object. 0.7 in the paper.
    n_text_views : int
        Number of photos in which the detector searches for a text, spread over the poses.
    photo_side : int
        Longer side in pixels to which photos are reduced for the detector and SAM.
    render_side : int
        Longer side in pixels of the views that are rendered to read features and count votes.
    erode_pixels : int
        Pixels removed along the border of a mask before its feature is read, because features mix at silhouettes.
    parts : int
        Largest number of directions in feature space for one prompt. SAM splits an object into parts of different
        materials, and each part has a direction of its own. 1 in the paper.
    part_purity : float
        A further direction is used when at least this share, 0 to 1, of the pixels with a similar feature is inside of
        the mask, among the connected areas that touch the mask.
    refinement : {"none", "votes"}
        ``none``: the cosine decides, as in the paper. ``votes``: masks of several views vote on every Gaussian with
        its blending weights.
    n_vote_views : int
        Largest number of views that vote.
    vote_rounds : int
        Number of rounds of voting. Each starts with the members that result from the round before.
    keep_given : bool
        Trust a mask that the user drew: in the first round of votes, the Gaussians behind it belong whatever their
        feature, and the Gaussians visible beside it never do.
    completion : {"none", "hull"}
        ``hull`` adds all Gaussians inside of the convex hull of the object, as in the paper.
    outlier_iqr : float or None
        Gaussians farther than this many interquartile ranges from the quartiles on any axis are ignored for the convex
        hull (Gaussian Grouping: 1.0). None ignores none.
    same_object : float
        Two results are one object when their Gaussians overlap by more than this share, 0 to 1, of the smaller one.
    n_rescored : int
        Number of a text's candidates from photos that are scored again by their appearance: each is cut out of photos
        from all sides. 0 keeps the detector's first score, as in the paper.
    n_groups : int
        Number of the scene's groups (`engine.objects.hierarchy`) that are scored in the same way: the prominent groups
        that look most like the text. With 0 no groups are used, and prominence does not count.
    n_crop_views : int
        Largest number of photos that each candidate is cut out of.
    least_candidate : float
        When the best candidate of a text scores less than this, 0 to 1, before it is completed, the text is not found.
    least_score : float
        When the best candidate of a text scores less than this, 0 to 1, after it is completed, the text is not found.
    relative_score : float
        Candidates of one text that score at least this share, 0 to 1, of the best score become objects.
    max_objects : int
        Largest number of objects for one text.
    n_level_views : int
        Number of photos in which SAM outlines larger levels of an object (`engine.objects.levels`). With 0 there are no
        levels; a mask that the user drew has none either.
    level_gain : float
        A larger level is chosen for a text when its score is more than this times the score of the object, at least 1.
    polish_steps : int
        Training steps in which an object's Gaussians are polished alone (`engine.objects.polishing`) before it is
        stored. 0 keeps them as they are in the scene.
    """

    cosine: float = 0.7  # published: Dahaghin et al. 2024
    n_text_views: int = 8  # chosen on museum_room
    photo_side: int = 1024  # by definition
    render_side: int = 480  # chosen on museum_room
    erode_pixels: int = 2  # chosen on museum_room
    parts: int = 6  # chosen on museum_room
    part_purity: float = 0.6  # chosen on museum_room
    refinement: Literal["none", "votes"] = "votes"  # chosen on museum_room
    n_vote_views: int = 24  # chosen on museum_room
    vote_rounds: int = 2  # chosen on museum_room
    keep_given: bool = True  # chosen on museum_room, store_room
    completion: Literal["none", "hull"] = "none"  # chosen on museum_room, store_room
    outlier_iqr: float | None = 1.0  # published: Ye et al. 2024
    same_object: float = 0.4  # chosen on museum_room
    n_rescored: int = 4  # chosen on museum_room
    n_groups: int = 4  # chosen on museum_room, store_room
    n_crop_views: int = 6  # chosen on museum_room
    least_candidate: float = 0.12  # chosen on museum_room
    least_score: float = 0.45  # chosen on museum_room
    relative_score: float = 0.85  # chosen on museum_room
    max_objects: int = 8  # by definition
    n_level_views: int = 8  # chosen on museum_room
    level_gain: float = 1.3  # chosen on museum_room, store_room
    polish_steps: int = 200  # chosen on museum_room

    def __post_init__(self) -> None:
        require(self, "cosine", -1.0 < self.cosine < 1.0, "between -1 and 1")
        require(self, "n_text_views", self.n_text_views >= 1, "at least 1")
        require(self, "photo_side", self.photo_side >= 64, "at least 64")
        require(self, "render_side", self.render_side >= 16, "at least 16")
        require(self, "erode_pixels", self.erode_pixels >= 0, "at least 0")
        require(self, "parts", self.parts >= 1, "at least 1")
        require(self, "part_purity", 0 < self.part_purity <= 1, "above 0 and at most 1")
        require(self, "refinement", self.refinement in ("none", "votes"), "'none' or 'votes'")
        require(self, "n_vote_views", self.n_vote_views >= 1, "at least 1")
        require(self, "vote_rounds", self.vote_rounds >= 1, "at least 1")
        require(self, "completion", self.completion in ("none", "hull"), "'none' or 'hull'")
        require(self, "outlier_iqr", self.outlier_iqr is None or self.outlier_iqr > 0, "above 0 or None")
        require(self, "same_object", 0 < self.same_object <= 1, "above 0 and at most 1")
        require(self, "n_rescored", self.n_rescored >= 0, "at least 0")
        require(self, "n_groups", self.n_groups >= 0, "at least 0")
        require(self, "n_crop_views", self.n_crop_views >= 1, "at least 1")
        require(self, "least_candidate", 0 <= self.least_candidate <= 1, "between 0 and 1")
        require(self, "least_score", 0 <= self.least_score <= 1, "between 0 and 1")
        require(self, "relative_score", 0 <= self.relative_score <= 1, "between 0 and 1")
        require(self, "max_objects", self.max_objects >= 1, "at least 1")
        require(self, "n_level_views", self.n_level_views >= 0, "at least 0")
        require(self, "level_gain", self.level_gain >= 1, "at least 1")
        require(self, "polish_steps", self.polish_steps >= 0, "at least 0")


BETTER = SegmentSettings()
"""Uses all parts that a mask shows, and lets masks of up to 24 views vote on every Gaussian."""

PAPER = replace(
    BETTER,
    parts=1,  # published: Dahaghin et al. 2024
    refinement="none",  # published: Dahaghin et al. 2024
    keep_given=False,
    completion="hull",  # published: Dahaghin et al. 2024
    n_rescored=0,
    n_groups=0,
    least_candidate=0.0,
    relative_score=0.6,  # chosen on museum_room
    n_level_views=0,
    polish_steps=0,
)  # by definition
"""Dahaghin et al. (2024): cosine 0.7 to the best-fitting mask of several views, then the convex hull."""

RELEASED = replace(PAPER, n_text_views=1, erode_pixels=0, outlier_iqr=None)  # published: Dahaghin et al. 2024
"""The paper's released code, which differs from its text: one photo, and no outliers removed before the hull."""

PRESETS = {"paper": PAPER, "released": RELEASED, "better": BETTER}
DEFAULT_PRESET = "better"
