"""Settings: bounds in one form of words, and one flat form in which they are stored."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Literal

import pytest

from engine.core.errors import SettingsError
from engine.core.settings import require, require_choices, to_dict


@dataclass(frozen=True)
class ToySettings:
    """Settings of a toy."""

    steps: int = 3
    kind: Literal["round", "flat"] = "round"

    def __post_init__(self) -> None:
        require_choices(self)
        require(self, "steps", self.steps >= 1, "at least 1")


@dataclass(frozen=True)
class ToyGroup:
    """A group of settings."""

    speed: float = 0.5


@dataclass(frozen=True)
class GroupedSettings:
    """Settings with a group of them."""

    steps: int = 3
    motion: ToyGroup = ToyGroup()


def test_groups_are_stored_flat() -> None:
    assert to_dict(GroupedSettings()) == {"steps": 3, "speed": 0.5}
    assert json.loads(json.dumps(to_dict(GroupedSettings()))) == to_dict(GroupedSettings())


def test_value_out_of_bounds_names_field_bound_and_value() -> None:
    with pytest.raises(SettingsError, match=r"`ToySettings\.steps` must be at least 1, got 0\."):
        ToySettings(0)


def test_value_that_its_type_does_not_name_is_refused_with_all_that_it_names() -> None:
    assert ToySettings(kind="flat").kind == "flat"
    with pytest.raises(SettingsError, match=r"`ToySettings\.kind` must be one of round, flat, got 'square'"):
        ToySettings(kind="square")  # type: ignore[arg-type]
