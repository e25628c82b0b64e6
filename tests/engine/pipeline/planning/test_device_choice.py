"""A card is used where it holds the scene; the sizes that a project was begun with stay, also elsewhere."""

from __future__ import annotations

from pathlib import Path

import pytest

from engine.cameras.settings import CameraSettings
from engine.core.errors import EnvironmentProblem, SettingsError
from engine.core.system import Machine
from engine.pipeline.planning.calibration import REFERENCE, Calibration
from engine.pipeline.planning.decisions import PlanSettings, WorkPlan, plan_work, training_settings
from engine.pipeline.planning.device_choice import (
    choose_sizes,
    kept_sizes,
    planned_device,
    record_sizes,
    training_is_to_come,
)
from engine.pipeline.planning.forecast import forecast_work
from engine.pipeline.planning.plan_text import format_plan
from engine.pipeline.planning.planned_work import store_forecast
from engine.project.folder import ProjectFolder
from engine.rasterizer import Device
from engine.training.card_settings import CARD_SIZES
from engine.training.schedule import Schedule
from engine.training.settings import PRESETS

from .scenes import photos, statistics

GIB = 1 << 30
MACHINE = Machine(2, 16 * GIB, "cpu", "test")


def card(memory: int | None = 24 * GIB, *, buffers: int = 2 * GIB, shared: bool = False) -> Device:
    own = None if shared else memory
    return Device("gpu", "Card (Vulkan)", max_buffer_bytes=buffers, memory=own, shares_memory=shared)


def plan(
    device: Device,
    preset: str = "standard",
    *,
    kept: dict[str, int] | None = None,
    wanted: str = "auto",
    n: int = 48,
    free: int | None = 16 * GIB,
    **sizes: int,
) -> WorkPlan:
    settings = PlanSettings(preset=preset, device=wanted, **sizes)  # type: ignore[arg-type]
    photo_set = photos(n, width=4000, height=3000)
    choice = choose_sizes(settings, photo_set, device, kept, free=free)
    return plan_work(photo_set, statistics(n), settings, cameras=CameraSettings(), poses_given=False, choice=choice)


def text(work: WorkPlan, tmp_path: Path) -> str:
    calibration = Calibration(tmp_path / "calibration.json", "key", REFERENCE)
    return format_plan(work, forecast_work(work, training_settings(work), MACHINE, calibration))


@pytest.fixture
def project(tmp_path: Path) -> ProjectFolder:
    return ProjectFolder.create(tmp_path / "project")


def test_presets_are_larger_on_a_card_and_as_ever_on_the_processor(tmp_path: Path) -> None:
    for preset, sizes in CARD_SIZES.items():
        work = plan(card(None), preset)
        training = training_settings(work)
        assert work.device.backend == "gpu" and training.growth.max_gaussians == sizes.max_gaussians
        assert (work.width, work.height) == (1600, 1200)
        assert plan(Device("cpu", "cpu"), preset).sizes == {}
        on_processor, own = training_settings(plan(Device("cpu", "cpu"), preset)), PRESETS[preset]
        interval = own.growth.grow_interval * on_processor.schedule.steps // own.schedule.steps
        assert on_processor.growth == own.changed(grow_interval=interval).growth
    said = text(plan(card()), tmp_path)
    assert "training on Card (Vulkan), about" in said and "of its 26 GB memory" in said
    assert "2 otherwise idle cores and Card (Vulkan)" in said


def test_best_is_standard_on_a_card_with_few_photos() -> None:
    best, standard = (plan(card(), preset, n=32) for preset in ("best", "standard"))
    assert best.sizes == standard.sizes and training_settings(best) == training_settings(standard)
    assert training_settings(plan(card(), "best")).growth.max_gaussians == 300_000
    small = GIB // 2
    assert plan(card(small), "best", n=32).sizes == plan(card(small), "standard", n=32).sizes
    on_processor = training_settings(plan(Device("cpu", "cpu"), "best", n=32))
    assert on_processor.growth.max_gaussians == PRESETS["best"].growth.max_gaussians


def test_all_bands_of_colour_are_used_on_a_card_where_the_processor_would_try_one() -> None:
    on_card, on_processor = training_settings(plan(card(None))), training_settings(plan(Device("cpu", "cpu")))
    assert (on_processor.appearance.sh_degree, on_processor.loss.dropout) == (1, 0.0)
    assert on_processor.appearance.trial_fraction > 0
    assert (on_card.appearance.sh_degree, on_card.appearance.trial_fraction) == (3, 0.0)
    assert on_card.appearance.sh_interval == 600 and on_card.loss.dropout == 0.05
    assert training_settings(plan(card(None), "preview")).appearance.sh_degree == 0


@pytest.mark.parametrize("preset", ["standard", "best"])
def test_training_on_a_card_reaches_the_number_of_gaussians_also_with_few_photos(preset: str) -> None:
    work = plan(card(None), preset)
    training = training_settings(work)
    schedule, n = Schedule(training, work.n_training, 1.0), 10_000
    for step in range(training.schedule.steps):
        n = schedule.gaussians_after_growth(step, n) if schedule.grows(step) else n
    assert training.schedule.steps == work.steps < PRESETS["best"].schedule.steps
    assert n == training.growth.max_gaussians


def test_user_may_ask_for_more_gaussians_and_larger_pictures_on_a_card() -> None:
    work = plan(card(None, buffers=8 * GIB), "best", max_gaussians=3_000_000, max_side=3_000)
    training = training_settings(work)
    assert (work.max_gaussians, work.width, training.schedule.max_side) == (3_000_000, 3_000, 3_000)
    schedule, n = Schedule(training, work.n_training, 1.0), 30_000
    for step in range(training.schedule.steps):
        n = schedule.gaussians_after_growth(step, n) if schedule.grows(step) else n
    assert n == 3_000_000, "growth is fast enough"
    small = plan(card(4 * GIB), "best", max_gaussians=3_000_000)
    assert 300_000 < small.max_gaussians < 3_000_000 and small.device.limited
    assert plan(card(None), "best", max_gaussians=50_000).max_gaussians == 50_000


def test_sizes_that_cannot_be_had_are_refused_with_a_sentence() -> None:
    with pytest.raises(
        SettingsError, match=r"--max-gaussians 3000000 needs training on a graphics card.*there is none"
    ):
        plan(Device("cpu", "cpu", "there is none"), max_gaussians=3_000_000)
    with pytest.raises(SettingsError, match="--max-side 900 cannot be used with the preset paper"):
        plan(card(None), "paper", max_side=900)
    with pytest.raises(SettingsError, match="at least 1,000, got 5"):
        plan(card(None), max_gaussians=5)


def test_wanted_sizes_of_a_begun_training_must_be_those_that_it_has() -> None:
    begun = plan(card(None), max_gaussians=500_000)
    kept = dict(begun.sizes)
    assert plan(card(None), kept=kept, max_gaussians=500_000) == begun
    elsewhere = plan(Device("cpu", "cpu", "there is none"), kept=kept, max_gaussians=500_000)
    assert training_settings(elsewhere) == training_settings(begun)
    for device in (card(None), Device("cpu", "cpu", "there is none"), begun.device):
        with pytest.raises(SettingsError, match="begun without --max-gaussians 900000 and keeps its sizes"):
            plan(device, kept=kept, max_gaussians=900_000)
    # What a card's memory allowed is asked for again.
    small = plan(card(4 * GIB), "best", max_gaussians=3_000_000)
    assert plan(card(4 * GIB), "best", kept=dict(small.sizes), max_gaussians=3_000_000).sizes == small.sizes


def test_plan_says_why_no_card_is_used(tmp_path: Path) -> None:
    said = text(plan(Device("cpu", "cpu", "this computer has no graphics card")), tmp_path)
    assert "training on the processor, because this computer has no graphics card" in said


def test_memory_of_the_card_limits_the_gaussians() -> None:
    assert plan(card(24 * GIB), "best").max_gaussians == plan(card(None), "best").max_gaussians == 300_000
    small = plan(card(3 * GIB // 2), "best")
    assert 120_000 <= small.max_gaussians < 300_000 and small.max_gaussians % 10_000 == 0
    assert small.device.n_bytes < 3 * GIB // 2
    assert f"Gaussians beyond {small.max_gaussians:,}" in [item.what for item in small.left_out]
    # The gradients of all pairs are one buffer.
    assert plan(card(None, buffers=32 << 20), "standard").max_gaussians < 100_000
    assert plan(card(shared=True), "best", free=3 * GIB // 2).max_gaussians < 300_000


def test_card_that_does_not_hold_the_scene_is_not_used_unless_it_is_demanded() -> None:
    work = plan(card(256 << 20), n=200)
    assert work.device.backend == "cpu" and work.sizes == {}
    assert "beside 200 photos of 1600 x 1200 pixels and this scene needs 40,000" in work.device.reason
    with pytest.raises(EnvironmentProblem, match="smaller preset or fewer photos, or use --device cpu"):
        plan(card(256 << 20), n=200, wanted="gpu")


def test_sizes_of_a_begun_training_stay_on_another_computer(project: ProjectFolder) -> None:
    begun = plan(card())
    assert kept_sizes(project, "standard") is None
    record_sizes(project, "standard", begun.sizes)
    kept = kept_sizes(project, "standard")
    assert kept == begun.sizes and kept_sizes(project, "best") is None
    elsewhere = plan(Device("cpu", "cpu", "there is none"), kept=kept)
    assert training_settings(elsewhere) == training_settings(begun)
    (note,) = [note for note in elsewhere.notes if "begun on" in note]
    assert "begun on a graphics card and keeps its sizes: at most 100,000 Gaussians" in note
    again = plan(card(), kept=kept)
    assert again == begun
    # A smaller card than the one that it was begun on: the processor continues it.
    small = plan(card(512 << 20), kept=kept)
    assert small.device.backend == "cpu" and "needs 100,000" in small.device.reason
    assert training_settings(small) == training_settings(begun)


def test_scene_of_the_processor_stays_as_it_is_where_there_is_a_card(project: ProjectFolder) -> None:
    record_sizes(project, "standard", {})
    assert kept_sizes(project, "standard") == {}
    work = plan(card(), kept={})
    assert work.device.backend == "gpu" and training_settings(work).growth == PRESETS["standard"].growth
    assert any("begun on the processor and keeps its sizes" in note for note in work.notes)


@pytest.mark.parametrize("stored", [5, [], {"standard": 5}, {"standard": {"steps": "many"}}, {"standard": {"x": 1}}])
def test_damaged_record_of_sizes_is_as_none(project: ProjectFolder, stored: object) -> None:
    project.put("training_sizes", stored)
    assert kept_sizes(project, "standard") is None


def test_finished_training_keeps_its_plan_without_a_look_at_the_cards(project: ProjectFolder, tmp_path: Path) -> None:
    assert training_is_to_come(project, "standard", photos_changed=False)
    project.finish_stage("training", "key", wall_seconds=1.0, cpu_seconds=1.0, figures={"preset": "standard"})
    assert not training_is_to_come(project, "standard", photos_changed=False)
    assert training_is_to_come(project, "best", photos_changed=False)
    assert training_is_to_come(project, "standard", photos_changed=True)
    work = plan(card(4 * GIB), "best")
    calibration = Calibration(tmp_path / "calibration.json", "key", REFERENCE)
    store_forecast(project, work, forecast_work(work, training_settings(work), MACHINE, calibration))
    assert planned_device(project, "best") == work.device
    assert planned_device(project, "standard") == Device(planned=True)
    assert plan(planned_device(project, "best"), "best", kept=dict(work.sizes)) == work
    project.put("work_plan", {"preset": "best", "device": {"backend": "cloud"}})
    assert planned_device(project, "best") == Device(planned=True)


def test_training_on_a_card_is_forecast_and_learned_for_each_card(tmp_path: Path) -> None:
    calibration = Calibration(tmp_path / "calibration.json", "key", REFERENCE)

    def training(work: WorkPlan) -> float:
        forecast = forecast_work(work, training_settings(work), MACHINE, calibration)
        return next(stage.seconds for stage in forecast.stages if stage.stage == "training")

    data_centre, separate, shared = plan(card(80 * GIB)), plan(card(24 * GIB)), plan(card(shared=True))
    assert 0 < training(data_centre) < training(separate) < training(shared)
    on_processor = training(plan(Device("cpu", "cpu")))
    before = training(separate)
    # Twenty times as long as forecast, which on the processor would count as no measure.
    calibration.add_outcome("training on Card (Vulkan)", "cpu", formula=10.0, actual=200.0)
    assert training(separate) > 5 * before and training(plan(Device("cpu", "cpu"))) == on_processor
    calibration.save()
