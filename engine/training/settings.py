"""Settings of training and the named presets. Standard library only: the command line and Blender read them.

A preset or a plan changes single settings with `TrainingSettings.changed`. Measurements behind the defaults are in
docs/design_notes/training.md.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from dataclasses import Field, dataclass, fields, is_dataclass, replace
from typing import Any, Literal

from ..core.errors import SettingsError
from ..core.settings import require, require_choices
from ..rasterizer.settings import Backend
from .setting_checks import require_at_least, require_factor, require_fraction, require_positive
from .validation import MIN_PHOTOS_TO_CHOOSE, validation_photos

PAPER_PIXELS = 980 * 735  # Dahaghin et al. 2024
"""Pixels of the pictures in the paper (Dahaghin et al. 2024), for which its pixel counts and sums over pixels hold."""

MAX_GROW_FACTOR = 2.0
"""Largest factor of a growth: a Gaussian has one copy or other half."""

LIGHT_SHARE = 0.5  # chosen on museum_room, banana16, herz_jesus25, meeting_place9, room_3, room_6, room_8
"""``kept`` of a light scene: see docs/training.md for what it costs."""
LIGHT_LABEL = "Light Scene"
LIGHT_DESCRIPTION = (
    "End with half of the Gaussians, those that the photos need most, for smaller files and faster views; objects can "
    "lose parts where there are few"
)

LAMBDA_DSSIM = 0.2
"""Weight of 1 - SSIM in the photometric loss, as in Kerbl et al. 2023; that of the mean |x - y| is the rest."""

PREVIEW_FILE = "preview.png"
"""Name of the preview picture in the folder of the checkpoints."""

TEST_PHOTOS = "test photos"
"""What a training's record calls the photos that a scene is measured on, where it was not trained on them."""

_MIN_ROUNDS_IN_TRIAL = 2  # chosen on museum_room
"""Least number of times that a trial trains on each photo."""

_READ_BY_STRATEGY = {"grow_factor": "opacity", "full_by": "mixed"}
"""Settings that only one ``growth_strategy`` reads."""

_FEW_PHOTOS_SH_DEGREE = 3  # chosen on herz_jesus25, meeting_place9, banana16, room_6, room_8
_FEW_PHOTOS_DROPOUT = 0.15  # chosen on herz_jesus25, meeting_place9, banana16, room_6, room_8
"""``sh_degree`` and ``dropout`` with fewer than `MIN_PHOTOS_TO_CHOOSE` training photos."""


@dataclass(frozen=True)
class ScheduleSettings:
    """How long training takes, and on pictures of which size.

    Attributes
    ----------
    steps : int
        Training steps, one photo each.
    rounds : int
        Largest number of times that each photo is trained on: the plan omits further steps. 0 omits none.
    max_side : int
        Longest side of the training pictures, pixels.
    coarse_levels : int
        Number of times that the pictures are halved at the start.
    cooldown : float
        Fraction of the steps, at the end, in which all learning rates fall further and no Gaussians are added.
    checkpoint_interval : int
        Steps between two checkpoints. A stopped run goes on from the last one, and words asked of the scene so far are
        answered from it.
    """

    steps: int = 3000  # chosen on museum_room
    rounds: int = 72  # chosen on museum_room, sakharov_statue32, banana16
    max_side: int = 640  # chosen on museum_room
    coarse_levels: int = 2  # chosen on museum_room
    cooldown: float = 0.1  # chosen on museum_room, sakharov_statue32
    checkpoint_interval: int = 200

    def __post_init__(self) -> None:
        require_at_least(self, 1, "steps", "checkpoint_interval")
        require_at_least(self, 0, "rounds", "coarse_levels")
        require(self, "coarse_levels", self.coarse_levels <= 5, "at most 5")
        require(self, "max_side", self.max_side >= 16, "at least 16 pixels")
        require_fraction(self, "cooldown")


@dataclass(frozen=True)
class OptimiserSettings:
    """Learning rates of Adam. "Extent" is the radius of the cameras' positions.

    Attributes
    ----------
    lr_means, lr_means_end : float
        Rate of the positions at the first and the last step, per extent; exponential in between.
    lr_scales, lr_quats, lr_opacity, lr_sh, lr_sh_rest, lr_features : float
        Rates of the other parameters; `lr_sh` is for band 0 of the spherical harmonics, `lr_sh_rest` for the others.
    lr_exposure : float
        Rate of the brightness factors.
    lr_end : float
        Factor that all rates but that of the positions reach at the last step; exponential over the second half of the
        steps.
    """

    lr_means: float = 1.6e-3  # chosen on museum_room
    lr_means_end: float = 1.6e-5  # chosen on museum_room
    lr_scales: float = 0.02  # chosen on museum_room
    lr_quats: float = 0.005  # chosen on museum_room
    lr_opacity: float = 0.05  # Kerbl et al. 2023
    lr_sh: float = 0.015  # chosen on museum_room
    lr_sh_rest: float = 0.00075  # chosen on museum_room
    lr_features: float = 0.01  # chosen on museum_room
    lr_exposure: float = 0.002  # chosen on museum_room
    lr_end: float = 0.2  # chosen on museum_room

    def __post_init__(self) -> None:
        require_positive(self, *(rate.name for rate in fields(self)))
        require_factor(self, "lr_end")


@dataclass(frozen=True)
class LossSettings:
    """Weights of the losses on the Gaussians' size and opacity, and dropout.

    Attributes
    ----------
    lambda_opacity, lambda_opacity_end : float
        Weights of the mean opacity before and after Gaussians are first added. Without them, Gaussians as black as the
        background cover it; a large second one leaves all translucent, so that masks show less of an object.
    lambda_scale : float
        Weight of the mean scale (per extent).
    dropout : float
        Fraction of the Gaussians left out of the last training picture; it rises from 0, see `densify.drop`.
    """

    lambda_opacity: float = 0.01  # chosen on museum_room, stability_scenes
    lambda_opacity_end: float = 0.0001  # chosen on more_rooms, stability_scenes
    lambda_scale: float = 0.002  # chosen on museum_room
    dropout: float = 0.0  # chosen on museum_room

    def __post_init__(self) -> None:
        require_at_least(self, 0, "lambda_opacity", "lambda_opacity_end", "lambda_scale")
        require(self, "dropout", 0 <= self.dropout < 1, "at least 0 and less than 1")


@dataclass(frozen=True)
class GrowthSettings:
    """Number of Gaussians: how many there are at the start, and how they are relocated, split and added.

    Attributes
    ----------
    max_gaussians : int
        Largest number of Gaussians. With ``growth_strategy="mixed"``, it grows with the width of the pictures.
    start_opacity : float
        Opacity of every Gaussian at the start.
    background_fraction : float
        Fraction of `max_gaussians` that a whole sphere of `background` has; 0 for none.
    growth_strategy : {"mixed", "opacity"}
        ``mixed``: drawn half by their error, half by opacity; half of them are copied, half split if they lie near
        initial ones; none stays near a camera. ``opacity``: copied, drawn by opacity, as published (Kheradmand et al.
        2024).
    grow_from, grow_until : float
        Fractions of the steps between which Gaussians are relocated and added.
    grow_interval : int
        Steps between two relocations.
    grow_factor : float
        With ``growth_strategy="opacity"``, factor by which the number of Gaussians grows each time, up to the largest.
    full_by : float
        With ``growth_strategy="mixed"``, part of the time of growth after which the largest number is reached, from any
        number of Gaussians at the start, by equal factors.
    kept : float
        Part of the largest number that is left in the end, see `thinning`; 1 removes none.
    noise : float
        Strength of the random walk of nearly transparent Gaussians.
    """

    max_gaussians: int = 40_000  # chosen on museum_room
    start_opacity: float = 0.5  # chosen on museum_room
    background_fraction: float = 0.05  # chosen on sakharov_statue32, sky_scene
    growth_strategy: Literal["mixed", "opacity"] = (
        "mixed"  # chosen on herz_jesus25, meeting_place9, banana16, skull66, sakharov_statue32, room_3
    )
    grow_from: float = 0.03  # chosen on museum_room
    grow_until: float = 0.8  # chosen on museum_room
    grow_interval: int = 60  # chosen on museum_room
    grow_factor: float = 1.05  # Kheradmand et al. 2024
    full_by: float = (
        0.7  # chosen on meeting_place9, banana16, herz_jesus25, sakharov_statue32, museum_room, room_3, room_6, room_8
    )
    kept: float = 1.0
    noise: float = 5e5  # Kheradmand et al. 2024

    def __post_init__(self) -> None:
        require_at_least(self, 1, "max_gaussians", "grow_interval")
        require(self, "start_opacity", 0 < self.start_opacity < 1, "between 0 and 1")
        require(self, "background_fraction", 0 <= self.background_fraction <= 0.5, "between 0 and 0.5")
        require_choices(self)
        require_fraction(self, "grow_from", "grow_until", "full_by")
        require(self, "grow_until", self.grow_until >= self.grow_from, "at least `grow_from`")
        factors = f"between 1 and {MAX_GROW_FACTOR:g}"
        require(self, "grow_factor", 1 <= self.grow_factor <= MAX_GROW_FACTOR, factors)
        for name, strategy in _READ_BY_STRATEGY.items():
            unchanged = getattr(self, name) == getattr(GrowthSettings, name)
            needed = f"left as it is: only growth_strategy={strategy} reads it"
            require(self, name, self.growth_strategy == strategy or unchanged, needed)
        require(self, "kept", 0 < self.kept <= 1, "above 0 and at most 1")
        require_at_least(self, 0, "noise")

    @property
    def n_background(self) -> int:
        """Number of Gaussians of a whole sphere of background."""
        return int(self.background_fraction * self.max_gaussians)


@dataclass(frozen=True)
class FeatureSettings:
    """Segmentation features and their losses, L_CC on rendered features and L_reg on those of neighbours.

    Attributes
    ----------
    train_features : bool
        Train segmentation features where photos have labels.
    feature_init : {"unit", "paper"}
        ``unit``: features are normalised before they are blended. ``paper``: they are blended without that.
    feature_gradient : {"detached", "joint"}
        ``joint``: the losses of the features also move the geometry (the paper). ``detached``: they do not.
    lambda_clustering : float
        Weight of L_CC, a sum over pixels and a mean over clusters (about 1e-6). It holds for pictures of 980 x 735
        pixels; for other sizes the sum is scaled to that.
    clustering_interval : int
        Steps between two evaluations of L_CC.
    clustering_pixels : int
        Random labelled pixels of a picture that L_CC is evaluated on; 0 for all.
    regularisation_interval : int
        Steps between two evaluations of L_reg.
    regularisation : {"neighbours", "paper"}
        ``neighbours``: the 6 nearest other Gaussians, and random ones far away. ``paper``: the 2 nearest, which include
        the Gaussian itself, and the 5 farthest.
    lambda_ray : float
        Weight of the disagreement of features along a ray; needs ``feature_init="unit"``.
    """

    train_features: bool = True  # Dahaghin et al. 2024
    feature_init: Literal["unit", "paper"] = "unit"  # chosen on museum_room, store_room
    feature_gradient: Literal["detached", "joint"] = "joint"  # Dahaghin et al. 2024
    lambda_clustering: float = 1e-6  # Dahaghin et al. 2024
    clustering_interval: int = 5  # chosen on museum_room
    clustering_pixels: int = 16_384  # chosen on museum_room
    regularisation_interval: int = 10  # chosen on museum_room
    regularisation: Literal["neighbours", "paper"] = "neighbours"  # chosen on museum_room
    lambda_ray: float = 0.01  # chosen on museum_room, store_room

    def __post_init__(self) -> None:
        require_at_least(self, 1, "clustering_interval", "regularisation_interval")
        require_at_least(self, 0, "clustering_pixels", "lambda_clustering", "lambda_ray")
        require_choices(self)
        ray_fits = self.lambda_ray == 0 or self.feature_init == "unit"
        require(self, "lambda_ray", ray_fits, 'zero when `feature_init` is "paper"')


@dataclass(frozen=True)
class AppearanceSettings:
    """What may differ between photos of the same place: view-dependent colour, exposure, transients.

    Attributes
    ----------
    sh_degree : int
        Bands of view-dependent colour (spherical harmonics), 0 to 3.
    sh_interval : int
        Steps after which one more band is used.
    exposure : bool
        Learn one brightness factor per photo and colour (mean 1 over the photos), for cameras with automatic exposure.
    lambda_exposure : float
        Weight of the squared logarithms of a photo's factors. It keeps them from drifting along the camera's path.
    transients : bool
        Leave out pixels that show something that no other photo shows, such as people who walk by. See `transients`.
    trial_fraction : float
        Fraction of the steps, and at least two rounds of the photos, for a trial: where a band of view-dependent colour
        is due, two copies are trained, with and without. 0 uses bands without a trial, and so does a run with fewer
        than 24 training photos.
    min_trial_gain : float
        PSNR on the validation photos, in dB, that a trial must gain; with less, the run goes on without the band.
    """

    sh_degree: int = 1  # chosen on museum_room
    sh_interval: int = 1500  # chosen on museum_room
    exposure: bool = True
    lambda_exposure: float = 0.1  # chosen on museum_room, store_room, room_6, room_8, herz_jesus25
    transients: bool = False  # chosen on museum_room
    trial_fraction: float = 0.025  # chosen on museum_room
    min_trial_gain: float = 0.02  # chosen on museum_room

    def __post_init__(self) -> None:
        require(self, "sh_degree", 0 <= self.sh_degree <= 3, "between 0 and 3")
        require_at_least(self, 1, "sh_interval")
        require_fraction(self, "trial_fraction")
        require_at_least(self, 0, "min_trial_gain", "lambda_exposure")


@dataclass(frozen=True)
class MeasurementSettings:
    """What is measured and shown during training.

    Attributes
    ----------
    held_out_every : int
        Every n-th photo is a test photo, 0 for none. Test photos are measured and never trained on, and nothing is
        decided on them.
    curve_points : int
        Measurements on the test photos, spaced evenly in the logarithm of the step.
    preview_seconds : float
        Time between two preview pictures.
    """

    held_out_every: int = 8  # Kerbl et al. 2023
    curve_points: int = 12
    preview_seconds: float = 30.0

    def __post_init__(self) -> None:
        require_at_least(self, 0, "held_out_every")
        require(self, "held_out_every", self.held_out_every != 1, "0 or at least 2: something must be trained on")
        require_at_least(self, 1, "curve_points")
        require_positive(self, "preview_seconds")


@dataclass(frozen=True)
class TrainingSettings:
    """How Gaussians are trained.

    The names of all fields of all groups differ, so that `changed` needs no group and `engine.core.settings.to_dict`
    stores them side by side.

    Attributes
    ----------
    schedule : ScheduleSettings
    optimiser : OptimiserSettings
    loss : LossSettings
    growth : GrowthSettings
    features : FeatureSettings
    appearance : AppearanceSettings
    measurement : MeasurementSettings
    seed : int
        Seed of every random draw.
    backend : {"cpu", "gpu", "reference"}
        Which rasterizer is used; ``gpu``: all of training runs on a graphics card.
    """

    schedule: ScheduleSettings = ScheduleSettings()
    optimiser: OptimiserSettings = OptimiserSettings()
    loss: LossSettings = LossSettings()
    growth: GrowthSettings = GrowthSettings()
    features: FeatureSettings = FeatureSettings()
    appearance: AppearanceSettings = AppearanceSettings()
    measurement: MeasurementSettings = MeasurementSettings()
    seed: int = 0
    backend: Backend = "cpu"

    def __post_init__(self) -> None:
        require_choices(self)

    def changed(self, **values: Any) -> TrainingSettings:
        """Return a copy with some settings changed, each given by its own name alone.

        Parameters
        ----------
        **values
            ``changed(steps=400, max_gaussians=600)`` changes ``schedule.steps`` and ``growth.max_gaussians``.

        Raises
        ------
        SettingsError
            When a name is no setting of training, or a value is out of bounds.
        """
        groups = {setting.name: group for group, setting in self.single_settings()}
        changes: dict[str, dict[str, Any]] = {}
        for name, value in values.items():
            if name not in groups:
                raise SettingsError(f"Training has no setting `{name}`. Did you mean `{self._nearest(name)}`?")
            changes.setdefault(groups[name], {})[name] = value
        own = changes.pop("", {})
        return replace(self, **own, **{group: replace(getattr(self, group), **new) for group, new in changes.items()})

    def for_photos(self, n_training: int) -> TrainingSettings:
        """Return these settings for `n_training` training photos.

        With fewer than `MIN_PHOTOS_TO_CHOOSE`, bands of colour cannot be tried. All bands are then used, one more after
        each quarter of the steps, and Gaussians are dropped, so that none fits a single photo. Settings without trials
        or bands are returned as they are.
        """
        tries = self.appearance.trial_fraction > 0 and self.appearance.sh_degree > 0
        if not tries or n_training >= MIN_PHOTOS_TO_CHOOSE:
            return self
        interval = max(1, self.schedule.steps // (_FEW_PHOTOS_SH_DEGREE + 1))
        return self.changed(sh_degree=_FEW_PHOTOS_SH_DEGREE, sh_interval=interval, dropout=_FEW_PHOTOS_DROPOUT)

    def with_steps(self, steps: int) -> TrainingSettings:
        """Return a copy with another number of steps, and with the intervals that are shares of it."""
        intervals = {"sh_interval": self.appearance.sh_interval, "grow_interval": self.growth.grow_interval}
        scaled = {name: max(1, interval * steps // self.schedule.steps) for name, interval in intervals.items()}
        return self.changed(steps=steps, **scaled)

    def trial_steps(self, n_training: int) -> int:
        """Return the steps of a trial in a run with `n_training` training photos; 0 where none is made."""
        part = round(self.appearance.trial_fraction * self.schedule.steps)
        n_validation = len(validation_photos(n_training))
        return max(part, _MIN_ROUNDS_IN_TRIAL * (n_training - n_validation)) if part and n_validation else 0

    def single_settings(self) -> Iterator[tuple[str, Field[Any]]]:
        """Yield the name of its group (empty for none) and the field, for each single setting."""
        for own in fields(self):
            value = getattr(self, own.name)
            if is_dataclass(value):
                yield from ((own.name, setting) for setting in fields(value))
            else:
                yield "", own

    def _nearest(self, name: str) -> str:
        """Return the setting whose name is most like `name`."""
        names = [setting.name for _, setting in self.single_settings()]
        return difflib.get_close_matches(name, names, n=1, cutoff=0.0)[0]


@dataclass(frozen=True)
class TrainingPreset:
    """Settings with a name and a sentence that says what they are for. What is not `offered` is for comparisons."""

    name: str
    description: str
    settings: TrainingSettings
    offered: bool = True

    @property
    def label(self) -> str:
        """Return the name as a label."""
        return self.name.capitalize()


_STANDARD = TrainingSettings()

PRESET_LIST: tuple[TrainingPreset, ...] = (
    TrainingPreset(
        "test", "A few seconds of training, for tests.",
        _STANDARD.changed(
            steps=60, rounds=0, lambda_opacity=0.0, lambda_opacity_end=0.0, max_gaussians=400,
            sh_degree=0, max_side=64, coarse_levels=1, curve_points=3, grow_interval=10,
            checkpoint_interval=20, clustering_interval=2,
            clustering_pixels=1024, regularisation_interval=4,
        ),
        offered=False,
    ),
    TrainingPreset(
        "preview", "A first look at the scene.",
        _STANDARD.changed(
            steps=600, rounds=0, max_gaussians=15_000, max_side=400, sh_degree=0,  # chosen on museum_room
            grow_interval=12,
        ),
    ),
    TrainingPreset("standard", "Right for most objects: a few minutes of training on two cores.", _STANDARD),
    TrainingPreset(
        "best", "The finest detail: an hour of training on two cores, with more Gaussians and larger pictures.",
        _STANDARD.changed(
            steps=12_000, max_gaussians=120_000, max_side=1000, sh_degree=2,  # chosen on museum_room
            sh_interval=4000, grow_interval=240, lr_means_end=4e-6, lr_end=0.1,  # chosen on museum_room
        ),
    ),
    TrainingPreset(
        "paper", "The published losses (Dahaghin et al. 2024) and growth (Kheradmand et al. 2024), for comparisons.",
        _STANDARD.changed(
            steps=30_000, start_opacity=0.1, sh_degree=3, sh_interval=1000,  # Kerbl et al. 2023
            lr_means=1.6e-4, lr_means_end=1.6e-6, lr_scales=0.005, lr_quats=0.001,  # Kerbl et al. 2023
            lr_opacity=0.05, lr_sh=0.0025, lr_sh_rest=0.000125,  # Kerbl et al. 2023
            max_gaussians=1_000_000, lambda_scale=0.01,  # Kheradmand et al. 2024
            lambda_opacity=0.01, lambda_opacity_end=0.01,  # Kheradmand et al. 2024
            growth_strategy="opacity", grow_interval=100,  # Kheradmand et al. 2024
            grow_from=500 / 30_000, grow_until=25_000 / 30_000,  # Kheradmand et al. 2024
            max_side=980, lr_features=0.0025, feature_init="paper",  # Dahaghin et al. 2024
            feature_gradient="joint", clustering_interval=50, clustering_pixels=0,  # Dahaghin et al. 2024
            regularisation="paper", regularisation_interval=100,  # Dahaghin et al. 2024
            rounds=0, background_fraction=0.0, coarse_levels=0, lr_end=1.0, cooldown=0.0,
            exposure=False, trial_fraction=0.0, lambda_ray=0.0,
        ),
        offered=False,
    ),
)  # fmt: skip
"""All presets, from the fastest to the slowest. Command line, Blender, server and its page read this list alone."""
OFFERED_PRESETS = tuple(preset for preset in PRESET_LIST if preset.offered)
DEFAULT_PRESET = "standard"

PRESETS: dict[str, TrainingSettings] = {preset.name: preset.settings for preset in PRESET_LIST}
"""The settings of the presets by name."""
