"""Training settings: single settings are changed by name, and each preset states its purpose."""

from __future__ import annotations

from collections import Counter
from dataclasses import fields, is_dataclass

import pytest

from engine.core.errors import SettingsError
from engine.training.settings import PRESET_LIST, PRESETS, TrainingSettings

STANDARD = PRESETS["standard"]


def test_settings_of_several_groups_are_changed_by_name_and_the_others_stay() -> None:
    changed = STANDARD.changed(steps=400, max_gaussians=600, seed=3)
    assert (changed.schedule.steps, changed.growth.max_gaussians, changed.seed) == (400, 600, 3)
    assert changed.schedule.max_side == STANDARD.schedule.max_side
    assert changed.features == STANDARD.features
    assert changed.changed(steps=3000, max_gaussians=40_000, seed=0) == STANDARD


@pytest.mark.parametrize(
    ("name", "nearest"), [("step", "steps"), ("transient", "transients"), ("max_gaussian", "max_gaussians")]
)
def test_unknown_setting_is_refused_with_the_nearest_name(name: str, nearest: str) -> None:
    with pytest.raises(SettingsError, match=f"no setting `{name}`. Did you mean `{nearest}`"):
        STANDARD.changed(**{name: 1})


def test_changed_value_out_of_bounds_names_the_field() -> None:
    with pytest.raises(SettingsError, match=r"`GrowthSettings\.max_gaussians` must be at least 1, got 0\."):
        STANDARD.changed(max_gaussians=0)


@pytest.mark.parametrize(
    ("changes", "strategy"),
    [({"grow_factor": 1.3}, "opacity"), ({"growth_strategy": "opacity", "full_by": 0.4}, "mixed")],
)
def test_a_setting_that_the_strategy_of_growth_does_not_read_is_refused(
    changes: dict[str, object], strategy: str
) -> None:
    with pytest.raises(SettingsError, match=f"left as it is: only growth_strategy={strategy} reads it"):
        STANDARD.changed(**changes)


def test_a_setting_that_the_strategy_of_growth_reads_is_changed() -> None:
    assert STANDARD.changed(growth_strategy="opacity", grow_factor=1.3).growth.grow_factor == 1.3
    assert STANDARD.changed(full_by=0.4).growth.full_by == 0.4


def test_names_differ_over_all_groups() -> None:
    """`changed` finds a setting by its name alone, and ``project.json`` stores all of them side by side."""
    names: Counter[str] = Counter()
    for own in fields(TrainingSettings):
        value = getattr(STANDARD, own.name)
        names.update(setting.name for setting in (fields(value) if is_dataclass(value) else [own]))
    assert names.most_common(1)[0][1] == 1


def test_every_preset_states_its_purpose_and_tests_are_not_offered() -> None:
    assert list(PRESETS) == [preset.name for preset in PRESET_LIST]
    assert all(preset.description.endswith(".") for preset in PRESET_LIST)
    assert [preset.name for preset in PRESET_LIST if preset.offered] == ["preview", "standard", "best"]
