"""What a graphics card changes in the settings: it affords more Gaussians, pixels and bands. Standard library only.

More Gaussians than these were measured to be worse on photo sets that do not determine them, see
docs/training_on_cards.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

from ..core.settings import to_dict
from .settings import DEFAULT_PRESET, PRESETS, TrainingSettings

_NOTHING: Mapping[str, int] = MappingProxyType({})

_ROUNDED_TO = 10_000
"""Numbers of Gaussians that memory decides are multiples of this."""

_SH_DEGREE, _DROPOUT = 3, 0.05  # chosen on museum_room, store_room, skull66, sakharov_statue32
"""``sh_degree`` and ``dropout`` in place of trials of bands. A card has the time for all bands, and with many Gaussians
an early trial refuses bands that gain later."""


@dataclass(frozen=True)
class CardSizes:
    """What a preset has on a card in place of its own sizes.

    Attributes
    ----------
    steps, rounds, max_side : int
        See `ScheduleSettings`.
    max_gaussians : int
        Largest number of Gaussians, on a card that holds so many.
    least_photos : int
        With fewer training photos, the preset is `DEFAULT_PRESET`: they do not determine more.
    """

    steps: int
    rounds: int
    max_side: int
    max_gaussians: int
    least_photos: int = 0


CARD_SIZES: dict[str, CardSizes] = {
    "preview": CardSizes(1_500, 0, 1_600, 40_000),
    "standard": CardSizes(3_000, 72, 1_600, 100_000),  # chosen on museum_room, sakharov_statue32, banana16
    "best": CardSizes(12_000, 190, 1_600, 300_000, 36),  # chosen on museum_room, sakharov_statue32
}
"""By the name of the preset. Presets that are not named here have their own sizes on a card too."""


def preset_on_card(preset: str, n_training: int) -> str:
    """Return the preset whose sizes and rates are used on a card for `n_training` training photos."""
    sizes = CARD_SIZES.get(preset)
    return DEFAULT_PRESET if sizes is not None and n_training < sizes.least_photos else preset


def sizes_on_card(preset: str, room: int, wanted: Mapping[str, int] = _NOTHING, *, n_training: int) -> dict[str, int]:
    """Return the settings that a preset has on a card in place of its own, by name; empty for none.

    Parameters
    ----------
    room : int
        Number of Gaussians that the card holds beside the photos.
    wanted : mapping of str to int
        ``max_gaussians`` and ``max_side`` that the user asked for.
    n_training : int
        Number of training photos.
    """
    preset = preset_on_card(preset, n_training)
    sizes = CARD_SIZES.get(preset)
    if sizes is None:
        return {}
    n = wanted.get("max_gaussians", sizes.max_gaussians)
    if room < n:
        n = max(PRESETS[preset].growth.max_gaussians, room // _ROUNDED_TO * _ROUNDED_TO)
    max_side = wanted.get("max_side", sizes.max_side)
    return {"steps": sizes.steps, "rounds": sizes.rounds, "max_side": max_side, "max_gaussians": n}


def settings_with_sizes(preset: str, sizes: Mapping[str, int], n_training: int) -> TrainingSettings:
    """Return the settings of a preset for `n_training` training photos, with the `sizes` of a card.

    On a card, all bands of colour are used where a preset would try bands: one more after each fifth of the steps.

    Parameters
    ----------
    sizes : mapping of str to int
        From `sizes_on_card`; empty on the processor.
    n_training : int
        Decides as `TrainingSettings.for_photos` does.
    """
    if not sizes:
        return PRESETS[preset].for_photos(n_training)
    base = PRESETS[preset_on_card(preset, n_training)]
    steps = sizes.get("steps", base.schedule.steps)
    settings = base.with_steps(steps).changed(**sizes).for_photos(n_training)
    if not (settings.appearance.sh_degree and settings.trial_steps(n_training)):
        return settings
    return settings.changed(
        sh_degree=_SH_DEGREE, sh_interval=max(1, steps // (_SH_DEGREE + 2)), trial_fraction=0.0, dropout=_DROPOUT
    )


def key_values(settings: TrainingSettings) -> dict[str, Any]:
    """Return the settings as keys of runs and stages hash them: the same for training on a card and on the processor.

    Their results differ as those of two computers do. A scene stays done, and a run continues, on the other one.
    """
    return to_dict(replace(settings, backend="cpu") if settings.backend == "gpu" else settings)
