"""The variants that are compared: the preset with one part exchanged, and combinations of such parts."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


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


VARIANTS = {
    variant.name: variant
    for variant in (
        Variant("as-planned"),
        Variant("detached", {"feature_gradient": "detached"}),
        Variant("no-features", features=False),
        Variant("no-background", {"background_fraction": 0.0}, features=False),
        Variant("growth-by-opacity", {"growth_strategy": "opacity"}, features=False),
        Variant("no-exposure", {"exposure": False}, features=False),
        Variant("free-exposure", {"lambda_exposure": 0.0}, features=False),
        Variant("half-steps", {"steps": 1500}, features=False),
        Variant("full-size-pictures", {"coarse_levels": 0}, features=False),
        Variant("low-rates", {"lr_means": 1.6e-4, "lr_means_end": 1.6e-6}, features=False),
        Variant(
            "half-rates",
            {
                "lr_means": 8e-4,
                "lr_means_end": 8e-6,
                "lr_scales": 0.01,
                "lr_quats": 0.0025,
                "lr_sh": 0.006,
                "lr_sh_rest": 0.0003,
            },
            features=False,
        ),  # fmt: skip
        Variant("bands-0", {"sh_degree": 0}, features=False),
        Variant("bands-1", {"sh_degree": 1, "sh_interval": 1500}, features=False),
        Variant("bands-3", {"sh_degree": 3, "sh_interval": 750, "trial_fraction": 0.0}, features=False),
        Variant("no-dropout", {"dropout": 0.0}, features=False),
        Variant("dropout", {"dropout": 0.15}, features=False),
        Variant("scale-weight-0.01", {"lambda_scale": 0.01}, features=False),
        Variant("no-opacity-prior", {"lambda_opacity": 0.0, "lambda_opacity_end": 0.0}, features=False),
        Variant("no-scale-prior", {"lambda_scale": 0.0}, features=False),
        Variant("no-noise", {"noise": 0.0}, features=False),
    )
}
"""Most are trained without features, which takes half the time and shows what the part itself does."""
