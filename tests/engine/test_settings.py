"""Settings: bounds in one form of words and a strict way back from JSON."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from engine.errors import SettingsError
from engine.settings import from_dict, require, to_dict


@dataclass(frozen=True)
class ToySettings:
    """Settings of a toy."""

    steps: int = 3

    def __post_init__(self) -> None:
        require(self, "steps", self.steps >= 1, "at least 1")


def test_settings_survive_json() -> None:
    assert from_dict(ToySettings, to_dict(ToySettings(5))) == ToySettings(5)


def test_value_out_of_bounds_names_field_bound_and_value() -> None:
    with pytest.raises(SettingsError, match=r"`ToySettings\.steps` must be at least 1, got 0\."):
        ToySettings(0)


def test_unknown_setting_is_refused_with_the_nearest() -> None:
    with pytest.raises(SettingsError, match=r"no setting `step`\. Did you mean `steps`\?"):
        from_dict(ToySettings, {"step": 3})
    with pytest.raises(SettingsError, match="Known: steps"):
        from_dict(ToySettings, {"colour": 3})
