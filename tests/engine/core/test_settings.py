"""Settings: bounds in one form of words, and stored names that outlive a renaming."""

from __future__ import annotations

import json
from dataclasses import dataclass, field

import pytest

from engine.cameras.settings import CameraSettings
from engine.core.errors import SettingsError
from engine.core.settings import require, to_dict
from engine.masks.settings import PRESETS as MASK_PRESETS
from engine.objects.settings import PRESETS as OBJECT_PRESETS
from engine.photos.settings import PhotoSettings
from engine.pipeline.objects_stage import _FIRST_RELEASE
from engine.project.folder import stage_key
from engine.training.earlier_releases import former_settings
from engine.training.settings import PRESETS as TRAINING_PRESETS


@dataclass(frozen=True)
class ToySettings:
    """Settings of a toy."""

    steps: int = 3

    def __post_init__(self) -> None:
        require(self, "steps", self.steps >= 1, "at least 1")


@dataclass(frozen=True)
class ToyGroup:
    """A group of settings."""

    speed: float = field(default=0.5, metadata={"stored_as": "pace"})


@dataclass(frozen=True)
class GroupedSettings:
    """Settings with a group of them."""

    steps: int = 3
    motion: ToyGroup = ToyGroup()


def test_groups_are_stored_flat_and_renamed_fields_under_their_stored_name() -> None:
    """So that a stage of an earlier release keeps its key."""
    assert to_dict(GroupedSettings()) == {"steps": 3, "pace": 0.5}
    assert json.loads(json.dumps(to_dict(GroupedSettings()))) == to_dict(GroupedSettings())


def test_value_out_of_bounds_names_field_bound_and_value() -> None:
    with pytest.raises(SettingsError, match=r"`ToySettings\.steps` must be at least 1, got 0\."):
        ToySettings(0)


@pytest.mark.parametrize(
    ("package", "preset", "key"),
    [
        ("training", "test", "dfb930bdf9a54214"),
        ("training", "preview", "f5fee388748ac13f"),
        ("training", "standard", "5ba3514d7dda82a2"),
        ("training", "best", "bbc9613e9b7888eb"),
        ("training", "paper", "120d739feaff5048"),
        ("masks", "default", "84d1f46357defdf3"),
        ("masks", "quick", "5813b5ad2a9d1170"),
        ("masks", "thorough", "7ac2302ac5a4387d"),
        ("masks", "published", "79812dd708a9d6e6"),
        ("masks", "paper", "d9f564a2500661d4"),
        ("objects", "paper", "c164d88450991d39"),
        ("objects", "released", "b14d820d52fd8729"),
        ("objects", "better", "4d85913e57ac653a"),
        ("cameras", "default", "92b02c74ee1f6bd3"),
        ("photos", "default", "126c0c066f2bbe37"),
    ],
)
def test_presets_have_the_stage_keys_of_the_first_release(package: str, preset: str, key: str) -> None:
    """A changed value is a changed result and may change its key here; a renamed field must not."""
    if package == "training":
        former = former_settings(TRAINING_PRESETS[preset], preset=preset, n_training=1000)
        assert any(stage_key(values).startswith(key) for values in former)
        return
    presets: dict[str, dict[str, object]] = {
        "masks": {**MASK_PRESETS},
        "objects": {**OBJECT_PRESETS},
        "cameras": {"default": CameraSettings()},
        "photos": {"default": PhotoSettings()},
    }
    assert stage_key(to_dict(presets[package][preset])).startswith(key)


def test_objects_of_the_first_release_are_known_by_its_settings() -> None:
    assert stage_key(_FIRST_RELEASE).startswith("9bc3a77cd1fe51d4")
