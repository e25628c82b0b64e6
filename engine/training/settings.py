"""Settings of training and the named presets. Standard library only: the command line and Blender read them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from ..settings import require

__all__ = ["PAPER_PIXELS", "PRESETS", "TrainingSettings"]

PAPER_PIXELS = 980 * 735
"""Size of the paper's pictures, for which its numbers of pixels and sums over pixels are meant."""

_ROUNDS_IN_TRIAL = 2
"""Of the photos, at least: in a single one, brightness factors of photos that differ by a third gained nothing yet."""


@dataclass(frozen=True)
class TrainingSettings:
    """How Gaussians are trained. Learning rates are Adam's; "extent" is the radius of the cameras' positions.

    Attributes
    ----------
    steps : int
        Training steps, one photo each.
    rounds : int
        How often each photo is trained on at most: with few photos the plan leaves out the steps beyond, which only
        learn those photos by heart; 0 leaves out none.
    max_gaussians : int
        Budget: growth stops here.
    start_opacity : float
        Opacity of every Gaussian at the start.
    background : float
        Part of the budget that starts where the photos show no sparse point: plain walls, sky.
    sh_degree : int
        Bands of view-dependent colour, 0 to 3.
    sh_interval : int
        Steps after which one more band is used.
    max_side : int
        Longest side of the training pictures, pixels.
    coarse_levels : int
        Times the pictures are halved at the start.
    coarse_until : float
        Part of the steps that smaller pictures would take if full size added no detail; each size takes as much of it
        as the share of the photos' detail that it adds. With ``growth="error"`` the budget of Gaussians grows with the
        pictures' width.
    lr_means, lr_means_end : float
        Position rate at the first and last step, per extent; exponential in between.
    lr_scales, lr_quats, lr_opacity, lr_sh, lr_sh_rest, lr_features : float
        Rates of the other parameters; `lr_sh` is for band 0, `lr_sh_rest` for the higher ones.
    lr_end : float
        All rates but the position's end at this part of themselves; exponential over the second half of the steps.
    cooldown : float
        Part of the steps at the end in which all rates fall further, and nothing grows.
    cooldown_end : float
        Part of themselves at which the cooldown leaves the rates; exponential. With it and the pictures' sizes by
        detail, a room reached 29.25 dB in 2,400 steps and 225 CPU s (before: 28.7 in 3,000 steps and 356), a statue
        19.5 in 2,400 and 213 (before: 19.0 to 19.2 in 2,600 to 3,000 and 237 to 316).
    lambda_dssim : float
        Share of 1 - SSIM in the photometric loss, 0 to 1.
    passers_by : bool
        Leave out what stands in one photo only: people who walk by (see `passers_by`). With people pasted into half of
        the photos of a room: 16 photos, 24.58 dB against 24.32 without; 42 photos, 28.7 to 28.9 against 28.9. Off
        unless asked for: without people the same room reached 29.05 against 29.27, as far apart as two seeds are.
    exposure : bool
        Learn one brightness factor per photo and colour (mean 1 over the photos), for cameras on automatic.
    trial : float
        Part of the steps, at least twice the photos, that two copies are trained for on the side, with and without,
        where a band of view-dependent colour or the brightness factors are due; 0 uses them untried, as do runs without
        held-out photos.
    trial_gain : float
        dB on the held-out photos that a trial must gain, else what was tried is left out of the whole run. One band of
        colours gained 0.047 dB in a room that ended at 29.40 dB with it and at 29.15 without.
    lr_exposure : float
        Its rate.
    features : bool
        Train segmentation features where photos have labels.
    feature_init : {"unit", "paper"}
        ``unit``: features are normalised before they are blended. ``paper``: blended as they are.
    feature_gradient : {"joint", "until_grown", "detached"}
        Whether L_CC moves the geometry too: always (the paper), until growth ends, or never.
    lambda_clustering : float
        Weight of L_CC, a sum over pixels and a mean over clusters (about 1e-6); for pictures of 980 x 735 pixels, of
        other sizes the sum is scaled to that.
    clustering_interval : int
        Steps between two evaluations of L_CC.
    clustering_pixels : int
        Random labelled pixels of a picture that L_CC is evaluated on; 0 for all.
    min_segment_pixels : int
        Smaller segments are left out of L_CC; counted at 980 x 735 pixels and scaled to the picture.
    lambda_pull, lambda_push : float
        Weights of the two parts of L_reg.
    regularisation_interval : int
        Steps between two evaluations of L_reg.
    regularisation : {"neighbours", "paper"}
        ``neighbours``: 6 true neighbours and random Gaussians far away. ``paper``: the 2 nearest, the Gaussian itself
        among them, and the 5 farthest.
    lambda_ray : float
        Weight of the disagreement of features along a ray; needs ``feature_init="unit"``.
    growth : {"error", "opacity"}
        ``error``: Gaussians in whose pixels the error is large are split. ``opacity``: copies of any, as published
        (Kheradmand et al. 2024).
    grow_from, grow_until : float
        Parts of the steps between which Gaussians are relocated and added.
    grow_interval : int
        Steps between two relocations.
    grow_factor : float
        The number of Gaussians is multiplied by at least this at each, up to the budget; with ``growth="error"`` by
        more where the budget would not be reached half-way.
    min_opacity : float
        Gaussians below it are dead and relocated.
    lambda_opacity, lambda_scale : float
        Weights of the mean opacity and the mean scale (per extent) in the loss. Without the first, Gaussians as black
        as the background cover it: balls before nothing were 35.5 dB with 18 % of the black covered, with 0.01 37.5 dB
        with 0.1 %; a room in `preview` 27.06 and 27.02 dB.
    noise : float
        Strength of the random walk of nearly transparent Gaussians.
    held_out_every : int
        Every n-th photo is never trained on, 0 for none.
    stop_when_flat : float
        dB; 0 never stops early. Once growth has ended, training stops when the error on the held-out photos, measured
        every 40th part of the steps, falls so slowly that the steps left would gain less than this. The photos held
        out thereby choose when to stop, and nothing else.
    curve_points : int
        Measurements on the held-out photos, spaced evenly in the logarithm of the step.
    checkpoint_interval : int
        Steps between two checkpoints.
    preview_seconds : float
        Time between two preview pictures.
    seed : int
        Of every random draw.
    backend : {"cpu", "reference"}
        Which rasterizer.
    """

    steps: int = 3000
    rounds: int = 72
    max_gaussians: int = 40_000
    start_opacity: float = 0.5
    background: float = 0.1
    sh_degree: int = 1
    sh_interval: int = 1500
    max_side: int = 640
    coarse_levels: int = 2
    coarse_until: float = 0.5
    lr_means: float = 1.6e-3
    lr_means_end: float = 1.6e-5
    lr_scales: float = 0.02
    lr_quats: float = 0.005
    lr_opacity: float = 0.05
    lr_sh: float = 0.015
    lr_sh_rest: float = 0.00075
    lr_features: float = 0.01
    lr_end: float = 0.2
    cooldown: float = 0.1
    cooldown_end: float = 0.05
    lambda_dssim: float = 0.2
    passers_by: bool = False
    exposure: bool = False
    lr_exposure: float = 0.002
    trial: float = 0.025
    trial_gain: float = 0.02
    features: bool = True
    feature_init: Literal["unit", "paper"] = "unit"
    feature_gradient: Literal["joint", "until_grown", "detached"] = "joint"
    lambda_clustering: float = 1e-6
    clustering_interval: int = 5
    clustering_pixels: int = 16_384
    min_segment_pixels: int = 100
    lambda_pull: float = 0.05
    lambda_push: float = 0.15
    regularisation_interval: int = 10
    regularisation: Literal["neighbours", "paper"] = "neighbours"
    lambda_ray: float = 0.01
    growth: Literal["error", "opacity"] = "error"
    grow_from: float = 0.03
    grow_until: float = 0.8
    grow_interval: int = 30
    grow_factor: float = 1.05
    min_opacity: float = 0.005
    lambda_opacity: float = 0.01
    lambda_scale: float = 0.002
    noise: float = 5e5
    held_out_every: int = 8
    stop_when_flat: float = 0.05
    curve_points: int = 12
    checkpoint_interval: int = 500
    preview_seconds: float = 30.0
    seed: int = 0
    backend: Literal["cpu", "reference"] = "cpu"

    def trial_steps(self, n_views: int) -> int:
        """Return the steps of a trial where `n_views` photos are trained on; 0 where none is made."""
        part = round(self.trial * self.steps)
        return max(part, _ROUNDS_IN_TRIAL * n_views) if part else 0

    def __post_init__(self) -> None:
        for name in ("steps", "max_gaussians", "sh_interval", "clustering_interval", "regularisation_interval",
                     "grow_interval", "checkpoint_interval", "curve_points"):  # fmt: skip
            require(self, name, getattr(self, name) >= 1, "at least 1")
        for name in ("rounds", "clustering_pixels", "min_segment_pixels", "held_out_every", "coarse_levels"):
            require(self, name, getattr(self, name) >= 0, "at least 0")
        for name in ("lr_means", "lr_means_end", "lr_scales", "lr_quats", "lr_opacity", "lr_sh", "lr_sh_rest",
                     "lr_features", "lr_exposure", "preview_seconds"):  # fmt: skip
            require(self, name, getattr(self, name) > 0, "greater than 0")
        for name in ("lambda_clustering", "lambda_pull", "lambda_push", "lambda_ray", "lambda_opacity",
                     "lambda_scale", "noise", "stop_when_flat", "trial_gain"):  # fmt: skip
            require(self, name, getattr(self, name) >= 0, "at least 0")
        for name in ("coarse_until", "cooldown", "lambda_dssim", "trial", "grow_from", "grow_until"):
            require(self, name, 0 <= getattr(self, name) <= 1, "between 0 and 1")
        require(self, "start_opacity", 0 < self.start_opacity < 1, "between 0 and 1")
        require(self, "background", 0 <= self.background <= 0.5, "between 0 and 0.5")
        require(self, "sh_degree", 0 <= self.sh_degree <= 3, "between 0 and 3")
        require(self, "max_side", self.max_side >= 16, "at least 16 pixels")
        require(self, "coarse_levels", self.coarse_levels <= 5, "at most 5")
        for name in ("lr_end", "cooldown_end"):
            require(self, name, 0 < getattr(self, name) <= 1, "greater than 0 and at most 1")
        require(self, "grow_factor", 1 <= self.grow_factor <= 2, "between 1 and 2")
        require(self, "grow_until", self.grow_until >= self.grow_from, "at least `grow_from`")
        require(self, "min_opacity", 0 < self.min_opacity < 0.5, "between 0 and 0.5")
        require(self, "held_out_every", self.held_out_every != 1, "0 or at least 2: something must be trained on")
        choices = {
            "feature_init": ("unit", "paper"),
            "feature_gradient": ("joint", "until_grown", "detached"),
            "regularisation": ("neighbours", "paper"),
            "growth": ("error", "opacity"),
            "backend": ("cpu", "reference"),
        }
        for name, allowed in choices.items():
            require(self, name, getattr(self, name) in allowed, "one of " + ", ".join(allowed))
        ray_fits = self.lambda_ray == 0 or self.feature_init == "unit"
        require(self, "lambda_ray", ray_fits, 'zero when `feature_init` is "paper"')


_STANDARD = TrainingSettings()

PRESETS: dict[str, TrainingSettings] = {
    "test": replace(
        _STANDARD, steps=60, rounds=0, lambda_opacity=0.0, max_gaussians=400, sh_degree=0, max_side=64,
        coarse_levels=1, curve_points=3, grow_interval=10, checkpoint_interval=20, clustering_interval=2,
        clustering_pixels=1024, regularisation_interval=4, stop_when_flat=0.0,
    ),
    "preview": replace(_STANDARD, steps=600, rounds=0, max_gaussians=15_000, max_side=400, sh_degree=0),
    "standard": _STANDARD,
    "best": replace(
        _STANDARD, steps=12_000, max_gaussians=120_000, max_side=1000, sh_degree=2, sh_interval=4000,
        grow_interval=100, lr_means_end=4e-6, lr_end=0.1, checkpoint_interval=200,
    ),
    "paper": replace(
        _STANDARD, steps=30_000, rounds=0, max_gaussians=1_000_000, start_opacity=0.1, background=0.0,
        sh_interval=1000,
        lambda_opacity=0.01, lambda_scale=0.01, max_side=980, sh_degree=3, coarse_levels=0,
        lr_means=1.6e-4, lr_means_end=1.6e-6, lr_scales=0.005, lr_quats=0.001, lr_opacity=0.05, lr_sh=0.0025,
        lr_sh_rest=0.000125, lr_features=0.0025, lr_end=1.0, cooldown=0.0, trial=0.0, feature_init="paper",
        feature_gradient="joint", clustering_interval=50, clustering_pixels=0, regularisation="paper",
        regularisation_interval=100, lambda_ray=0.0, growth="opacity", grow_from=500 / 30_000,
        grow_until=25_000 / 30_000, grow_interval=100, stop_when_flat=0.0,
    ),
}  # fmt: skip
"""``test``: seconds, for tests. ``preview``: a first look. ``standard``: a few minutes on two cores. ``best``: an hour.
``paper``: the published losses and rates (Dahaghin et al. 2024) on a fixed budget (Kheradmand et al. 2024)."""
