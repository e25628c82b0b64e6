"""The variants that are compared: the preset with one part exchanged, and combinations of such parts."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

__all__ = ["VARIANTS", "Variant"]


@dataclass(frozen=True)
class Variant:
    """A change of the method.

    Attributes
    ----------
    name : str
        Of the row in the tables.
    changes : dict
        Settings that differ from those that the plan chooses, see `TrainingSettings.changed`.
    features : bool
        Whether segmentation features are trained.
    """

    name: str
    changes: dict[str, Any] = field(default_factory=dict)
    features: bool = True


_ALL_STEPS = {"stop_when_flat": 0.0}

VARIANTS = {
    variant.name: variant
    for variant in (
        Variant("as-planned"),
        Variant("no-early-stop", _ALL_STEPS),
        Variant("detached", {"feature_gradient": "detached"}),
        Variant("no-features", features=False),
        Variant("no-exposure", {"exposure": False}),
        Variant("no-guesses", {"background_fraction": 0.0}),
        Variant("low-rates", {"lr_means": 1.6e-4, "lr_means_end": 1.6e-6}),
        Variant("growth-by-opacity", {"growth_strategy": "opacity"}),
        Variant("growth-mixed", {"growth_strategy": "mixed"}),
        Variant("full-size-pictures", {"coarse_levels": 0}),
        Variant("all-steps", {"steps": 3000, **_ALL_STEPS}),
        Variant("bands-3", {"sh_degree": 3, "trial_fraction": 0.0}),
        Variant("scale-weight-0.01", {"lambda_scale": 0.01}),
    )
}
