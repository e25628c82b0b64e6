"""A setting of training is given by its name; what cannot be meant is refused with one sentence."""

from __future__ import annotations

import argparse

import pytest

from engine.cli.commands.scene_options import add_setting_options, overrides_of
from engine.core.errors import SettingsError
from engine.core.settings import to_dict
from engine.pipeline.planning.decisions import PlanSettings, training_settings
from engine.rasterizer import PROCESSOR
from engine.training.overrides import read_overrides, settable_names
from engine.training.settings import TrainingSettings
from tests.engine.pipeline.planning.test_device_choice import plan


def test_values_have_the_type_of_the_setting() -> None:
    texts = ["lr_means=1e-3", "steps=50", "exposure=false", " growth_strategy = opacity ", "noise=0"]
    values = read_overrides(texts)
    assert values == {"lr_means": 1e-3, "steps": 50, "exposure": False, "growth_strategy": "opacity", "noise": 0.0}
    assert isinstance(values["noise"], float)


def test_every_name_that_is_listed_can_be_set_to_its_default() -> None:
    defaults = {setting.name: setting.default for _, setting in TrainingSettings().single_settings()}
    texts = [f"{name}={str(defaults[name]).lower()}" for name in settable_names()]
    assert TrainingSettings().changed(**read_overrides(texts)) == TrainingSettings()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("lr_mean=1", "no setting `lr_mean`. --set takes one of these: .*lr_means, lr_means_end"),
        ("steps", "takes name=value"),
        ("=3", "takes name=value"),
        ("steps=many", "`steps` of training is a whole number, and --set gives 'many'"),
        ("steps=3.5", "is a whole number"),
        ("lr_means=nan", "`lr_means` of training is a number"),
        ("exposure=1", "is true or false"),
        ("backend=gpu", "use the option --device"),
        ("train_features=false", "use the option --no-objects"),
    ],
)
def test_what_cannot_be_meant_is_refused(text: str, said: str) -> None:
    with pytest.raises(SettingsError, match=said):
        read_overrides([text])


def test_a_setting_given_twice_is_refused() -> None:
    with pytest.raises(SettingsError, match="gives `steps` twice"):
        read_overrides(["steps=3", "steps=4"])


def test_a_value_out_of_bounds_is_refused_before_any_work() -> None:
    with pytest.raises(SettingsError, match="`OptimiserSettings.lr_means` must be greater than 0"):
        PlanSettings(overrides={"lr_means": -1.0})


def test_the_plan_and_its_training_have_what_was_set() -> None:
    given = {"steps": 9000, "lambda_clustering": 3e-6, "sh_degree": 1, "held_out_every": 4, "max_side": 320}
    before, work = plan(PROCESSOR), plan(PROCESSOR, overrides=given)  # type: ignore[arg-type]
    assert (work.steps, work.sh_degree, max(work.width, work.height)) == (9000, 1, 320)
    assert work.n_held_out > before.n_held_out and work.overrides == given
    values = to_dict(training_settings(work))
    assert {name: values[name] for name in given} == given
    assert before.overrides == {} and to_dict(training_settings(before))["steps"] != 9000


def test_a_light_scene_keeps_half_of_the_gaussians_and_is_asked_for_once() -> None:
    parser = argparse.ArgumentParser()
    add_setting_options(parser)
    assert overrides_of(parser.parse_args(["--light", "--set", "steps=50"])) == {"steps": 50, "kept": 0.5}
    assert overrides_of(parser.parse_args([])) == {}
    with pytest.raises(SettingsError, match="Give only one"):
        overrides_of(parser.parse_args(["--light", "--set", "kept=0.3"]))
