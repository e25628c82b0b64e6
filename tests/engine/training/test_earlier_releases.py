"""What release 0.1.0 trained stays done although the defaults are others now."""

from __future__ import annotations

from typing import Any

from engine.core.settings import to_dict
from engine.training.earlier_releases import former_settings
from engine.training.settings import PRESETS, TrainingSettings

PLANNED = PRESETS["standard"]


def without_later_settings(settings: TrainingSettings) -> dict[str, Any]:
    values = to_dict(settings)
    del values["lambda_exposure"], values["dropout"], values["lambda_opacity_end"]
    return values


def test_the_former_defaults_of_a_few_photos_are_among_them() -> None:
    former = {**without_later_settings(PLANNED), "growth": "error", "background": 0.1, "stop_when_flat": 0.05}
    settings = former_settings(PLANNED, preset="standard", n_training=40)
    assert {**former, "steps": 72 * 40, "sh_interval": 1440} in settings
    few = former_settings(PLANNED.for_photos(9), preset="standard", n_training=9)
    assert {**former, "steps": 1500, "sh_interval": 750} in few
    assert to_dict(PLANNED) not in settings


def test_what_the_user_chose_stays_as_it_is() -> None:
    chosen = {"max_gaussians": 5000, "max_side": 320, "features": False, "seed": 3}
    changed = PLANNED.changed(**{"train_features" if k == "features" else k: v for k, v in chosen.items()})
    for former in former_settings(changed, preset="standard", n_training=40):
        assert {name: former[name] for name in chosen} == chosen


def test_the_published_method_is_the_same_as_before() -> None:
    published = {**without_later_settings(PRESETS["paper"]), "stop_when_flat": 0.0}
    assert published in former_settings(PRESETS["paper"], preset="paper", n_training=40)
