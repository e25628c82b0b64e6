"""Training a tiny scene: errors fall, runs resume exactly, stop on request, and stay finite."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections import Counter
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from engine.core.errors import Cancelled, DiskError, NumericalError, TrainingError
from engine.core.events import Event, Metric, Preview, Progress, StopCheck, Warned, ignore_events, never_stop
from engine.core.label_runs import LabelRuns
from engine.scene.gaussians import Gaussians
from engine.training.checkpoint import CHECKPOINT_FILE, delete_old_runs, latest_run
from engine.training.guards import clamp_parameters, step_finite_rows
from engine.training.loop import train
from engine.training.parameters import Parameters
from engine.training.result import TrainingResult
from engine.training.settings import PRESETS, TrainingSettings
from tests.conftest import ROOT, wait_until

from .conftest import Scene
from .segment_agreement import segment_agreement, untrained_features

QUICK = PRESETS["test"]
LONGER = QUICK.changed(steps=400, curve_points=4)


def run(
    scene: Scene,
    settings: TrainingSettings,
    folder: Path,
    *,
    events: list[Event] | None = None,
    stop: StopCheck = never_stop,
) -> TrainingResult:
    emit = ignore_events if events is None else events.append
    return train(scene.start, scene.views, settings, checkpoints=folder, emit=emit, should_stop=stop)


def stop_after(steps: int) -> StopCheck:
    calls = iter(range(10**9))
    return lambda: next(calls) >= steps


def same(one: Gaussians, other: Gaussians) -> bool:
    pairs = [(getattr(one, f.name), getattr(other, f.name)) for f in fields(one)]
    return all((a is None and b is None) or np.array_equal(a, b) for a, b in pairs)


@pytest.fixture(scope="module")
def quick(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> TrainingResult:
    return run(scene, QUICK, tmp_path_factory.mktemp("quick"))


@pytest.fixture(scope="module")
def longer(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> tuple[TrainingResult, list[Event]]:
    events: list[Event] = []
    return run(scene, LONGER, tmp_path_factory.mktemp("longer"), events=events), events


def test_photos_not_trained_on_are_predicted(longer: tuple[TrainingResult, list[Event]]) -> None:
    curve = longer[0].curve
    # Seeds 0 to 4 go from 12.1 to between 27.3 and 28.2 dB.
    assert curve[-1].psnr > 25.5
    assert curve[-1].psnr > curve[0].psnr + 10
    assert curve[-1].ssim > curve[0].ssim
    assert curve[-1].l1 < curve[0].l1


def test_curve_holds_error_against_time(longer: tuple[TrainingResult, list[Event]]) -> None:
    result = longer[0]
    assert [point.step for point in result.curve][-1] == 400
    for name in ("step", "wall_seconds", "cpu_seconds", "n_gaussians"):
        values = [getattr(point, name) for point in result.curve]
        assert values == sorted(values), name
    assert result.figures["measured_photos"] == ["04.jpg"]
    assert result.figures["n_gaussians"] == len(result.gaussians) <= LONGER.growth.max_gaussians


def test_features_separate_two_balls_where_untrained_ones_do_not(
    scene: Scene, longer: tuple[TrainingResult, list[Event]]
) -> None:
    held_out = [view for view in scene.views if view.held_out]
    gaussians = longer[0].gaussians
    trained = segment_agreement(gaussians, held_out, min_pixels=30)
    untrained = segment_agreement(untrained_features(gaussians), held_out, min_pixels=30)
    assert trained.n_segments == 3
    # Seeds 0 to 4: 0.95 to 0.97 against 0.15 to 0.18.
    assert trained.mean_iou > 0.85
    assert untrained.mean_iou < 0.3


def test_user_sees_progress_metrics_and_a_preview(longer: tuple[TrainingResult, list[Event]]) -> None:
    events = longer[1]
    progress = [event for event in events if isinstance(event, Progress)]
    assert progress[-1].fraction == 1
    assert progress[-1].seconds_left == 0
    assert {event.name for event in events if isinstance(event, Metric)} >= {"loss", "psnr"}
    preview = next(event for event in events if isinstance(event, Preview))
    with Image.open(preview.path) as picture:
        assert picture.size == (64, 48)


def test_preview_that_another_program_holds_does_not_end_training(
    scene: Scene, quick: TrainingResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Blender's own preview and Explorer keep pictures open on Windows."""

    def held(path: Path, image: object) -> None:
        raise DiskError(f"Could not write {path}: in use. Close it.")

    monkeypatch.setattr("engine.training.loop.write_picture", held)
    often = QUICK.changed(preview_seconds=1e-6)
    events: list[Event] = []
    result = run(scene, often, tmp_path, events=events)
    assert same(result.gaussians, quick.gaussians)
    assert not any(isinstance(event, Preview) for event in events)
    assert ["preview.png" in event.message for event in events if isinstance(event, Warned)].count(True) == 1


def test_same_seed_gives_the_same_gaussians(scene: Scene, quick: TrainingResult, tmp_path: Path) -> None:
    assert same(run(scene, QUICK, tmp_path).gaussians, quick.gaussians)
    other = run(scene, QUICK.changed(seed=1), tmp_path / "other")
    assert not same(other.gaussians, quick.gaussians)


def test_training_cancelled_again_and_again_resumes_exactly(
    scene: Scene, quick: TrainingResult, tmp_path: Path
) -> None:
    events: list[Event] = []
    for step, done in ((1, 0), (19, 1), (37, 19)):
        with pytest.raises(Cancelled):
            run(scene, QUICK, tmp_path, events=events, stop=stop_after(step - done))
        assert (tmp_path / CHECKPOINT_FILE).is_file()
    events.clear()
    resumed = run(scene, QUICK, tmp_path, events=events)
    assert any(isinstance(event, Progress) and "continued" in event.message for event in events)
    assert same(resumed.gaussians, quick.gaussians)
    assert [(p.step, p.psnr) for p in resumed.curve] == [(p.step, p.psnr) for p in quick.curve]
    emitted = [(e.step, e.value, e.seconds) for e in events if isinstance(e, Metric) and e.name == "psnr"]
    assert emitted == [(p.step, p.psnr, p.wall_seconds) for p in resumed.curve]
    assert list(tmp_path.glob(".writing-*")) == []


_CHILD = """
import sys
from pathlib import Path
from tests.engine.training.conftest import make_scene
from tests.engine.training.test_loop import QUICK, run
run(make_scene(), QUICK, Path(sys.argv[1]))
"""


def test_killed_training_continues_from_its_checkpoint(scene: Scene, quick: TrainingResult, tmp_path: Path) -> None:
    child = subprocess.Popen([sys.executable, "-c", _CHILD, str(tmp_path)], cwd=ROOT, env=os.environ)
    wait_until(lambda: (tmp_path / CHECKPOINT_FILE).is_file() or child.poll() is not None)
    child.send_signal(signal.SIGKILL)
    child.wait()
    assert (tmp_path / CHECKPOINT_FILE).is_file()
    assert same(run(scene, QUICK, tmp_path).gaussians, quick.gaussians)


def test_checkpoint_of_other_settings_or_damaged_is_not_continued(
    scene: Scene, quick: TrainingResult, tmp_path: Path
) -> None:
    with pytest.raises(Cancelled):
        run(scene, QUICK.changed(lr_sh=0.1), tmp_path, stop=stop_after(10))
    assert same(run(scene, QUICK, tmp_path).gaussians, quick.gaussians)
    (tmp_path / CHECKPOINT_FILE).write_bytes((tmp_path / CHECKPOINT_FILE).read_bytes()[:5000])
    assert same(run(scene, QUICK, tmp_path).gaussians, quick.gaussians)


def test_learning_rates_a_hundred_times_too_high_give_finite_gaussians_or_a_clear_error(
    scene: Scene, tmp_path: Path
) -> None:
    rates = {f.name: 100 * getattr(QUICK.optimiser, f.name) for f in fields(QUICK.optimiser) if f.name != "lr_end"}
    try:
        result = run(scene, QUICK.changed(**rates), tmp_path)
    except NumericalError as error:
        assert "learning rate" in str(error)
        return
    for f in fields(result.gaussians):
        assert np.isfinite(getattr(result.gaussians, f.name)).all(), f.name
    assert result.figures["limits"]["scales_at_limit"] > 0


def test_gradients_that_are_not_finite_leave_their_gaussians_alone_and_are_counted(scene: Scene) -> None:
    parameters = Parameters.from_gaussians(scene.start, sh_degree=0, features=True)
    parameters.track()
    for value in parameters.values.values():
        value.grad = torch.ones_like(value)
    parameters.values["means"].grad[3, 1] = torch.nan
    parameters.values["sh_dc"].grad[7] = -torch.inf
    before = {name: value.detach().clone() for name, value in parameters.values.items()}
    guards: Counter[str] = Counter()
    step_finite_rows(parameters, lambda: parameters.step(dict.fromkeys(before, 0.1)), guards)
    assert guards == {"gaussians_not_updated": 2}
    still = torch.tensor([3, 7])
    for name, value in parameters.values.items():
        changed = (value.detach() != before[name]).reshape(len(value), -1).any(dim=1)
        assert not changed[still].any(), name
        assert int(changed.sum()) == len(value) - 2, name
        assert not parameters.moments[name].mean[still].any()


def test_extreme_values_are_clamped_and_counted(scene: Scene) -> None:
    parameters = Parameters.from_gaussians(scene.start, sh_degree=0, features=False)
    values = parameters.values
    values["log_scales"][0] = torch.tensor([60.0, -60.0, 0.0])
    values["log_scales"][1] = -80.0
    values["opacity_logits"][2] = 1e6
    values["means"][3] = torch.tensor([1e30, 0.0, -1e30])
    values["quats"][4] = 0.0
    guards: Counter[str] = Counter()
    clamp_parameters(parameters, torch.zeros(3), 1.0, guards)
    expected = {"scales_at_limit": 2, "opacities_at_limit": 1, "clamped_positions": 1, "reset_rotations": 1}
    assert dict(guards) == expected
    scales = values["log_scales"].exp()
    assert (scales.amax(dim=1) / scales.amin(dim=1) <= 50.01).all()
    assert all(bool(torch.isfinite(value).all()) for value in values.values())
    clamp_parameters(parameters, torch.zeros(3), 1.0, guards)
    assert dict(guards) == expected


def test_features_leave_the_geometry_as_without_them_unless_they_are_joint(scene: Scene, tmp_path: Path) -> None:
    settings = QUICK.changed(steps=20, grow_until=0.0, grow_from=0.0, feature_gradient="detached", curve_points=1)
    with_features = run(scene, settings, tmp_path / "a").gaussians
    without = run(scene, settings.changed(train_features=False), tmp_path / "b").gaussians
    assert with_features.features is not None
    assert without.features is None
    assert np.array_equal(with_features.means, without.means)
    joint = run(scene, settings.changed(feature_gradient="joint"), tmp_path / "c").gaussians
    assert not np.array_equal(joint.means, without.means)


def test_published_losses_run_too(scene: Scene, tmp_path: Path) -> None:
    paper = PRESETS["paper"].changed(
        steps=60, max_gaussians=400, sh_interval=20, clustering_interval=2, grow_interval=10,
        regularisation_interval=4, curve_points=2,
    )  # fmt: skip
    result = run(scene, paper, tmp_path)
    assert result.curve[-1].psnr > result.curve[0].psnr
    assert result.gaussians.sh.shape[1:] == (16, 3)
    norms = np.linalg.norm(result.gaussians.features, axis=1)
    assert norms.std() > 0.01


def test_both_kinds_of_growth_add_gaussians_and_lower_the_error(scene: Scene, tmp_path: Path) -> None:
    settings = QUICK.changed(max_gaussians=len(scene.start) + 40, grow_interval=10)
    results = [run(scene, settings.changed(growth_strategy=s), tmp_path / s) for s in ("mixed", "opacity")]
    for result in results:
        assert len(scene.start) < len(result.gaussians) <= len(scene.start) + 40
        assert result.curve[-1].psnr > result.curve[0].psnr
    assert not same(results[0].gaussians, results[1].gaussians)


def test_only_the_features_of_the_background_are_trained(scene: Scene, tmp_path: Path) -> None:
    settings = QUICK.changed(grow_interval=10, max_gaussians=len(scene.start) + 80)
    background = replace(scene.start[:30], means=30.0 * scene.start.means[:30])
    result = train(
        scene.start[30:], scene.views, settings, checkpoints=tmp_path / "a", emit=ignore_events,
        should_stop=never_stop, background=background,
    )  # fmt: skip
    assert result.figures["n_background"] == 30 and len(result.gaussians) > len(scene.start)
    trained = result.gaussians[:30]
    for name in ("means", "log_scales", "opacity_logits", "sh"):
        np.testing.assert_array_equal(getattr(trained, name), getattr(background, name))
    # What lies 30 times as far away is copied from the background only.
    distances = np.linalg.norm(result.gaussians.means[30:], axis=1)
    assert distances.max() < 0.8 * np.linalg.norm(background.means, axis=1).min()
    assert background.features is not None and trained.features is not None
    assert np.abs(trained.features - background.features).max() > 0.01


def test_a_run_with_a_background_continues_bit_for_bit(scene: Scene, tmp_path: Path) -> None:
    settings = QUICK.changed(steps=24, grow_interval=6, checkpoint_interval=10, max_gaussians=len(scene.start) + 40)
    background = replace(scene.start[:30], means=30.0 * scene.start.means[:30])

    def trained(folder: Path, stop: StopCheck) -> TrainingResult:
        return train(
            scene.start[30:], scene.views, settings, checkpoints=folder, emit=ignore_events, should_stop=stop,
            background=background,
        )  # fmt: skip

    whole = trained(tmp_path / "a", never_stop)
    calls = iter(range(1000))
    with pytest.raises(Cancelled):
        trained(tmp_path / "b", lambda: next(calls) >= 13)
    assert same(trained(tmp_path / "b", never_stop).gaussians, whole.gaussians)


def brightness_of_photos(scene: Scene, folder: Path, **changes: float) -> dict[int, float]:
    """Return the brightness factors of photos of which every other one was darkened to 0.7, by number."""

    def darkened(view_index: int, pixels: np.ndarray) -> np.ndarray:
        return (pixels * (0.7 if view_index % 2 else 1.0)).round().astype(np.uint8)

    views = [replace(view, pixels=darkened(i, view.pixels), labels=None) for i, view in enumerate(scene.views)]
    settings = LONGER.changed(lr_exposure=0.01, **changes)
    result = train(scene.start, views, settings, checkpoints=folder, emit=ignore_events, should_stop=never_stop)
    return {int(name[:2]): float(np.mean(gain)) for name, gain in result.figures["exposure"].items()}


def test_brightness_factors_of_photos_are_estimated_with_a_mean_of_one(scene: Scene, tmp_path: Path) -> None:
    gains = brightness_of_photos(scene, tmp_path)
    dark = np.mean([gain for index, gain in gains.items() if index % 2])
    light = np.mean([gain for index, gain in gains.items() if not index % 2])
    assert dark / light == pytest.approx(0.7, abs=0.06)
    assert np.mean(np.log(list(gains.values()))) == pytest.approx(0.0, abs=0.01)


def test_a_strong_prior_keeps_the_brightness_of_all_photos_equal(scene: Scene, tmp_path: Path) -> None:
    gains = brightness_of_photos(scene, tmp_path, lambda_exposure=100.0)
    assert max(abs(gain - 1.0) for gain in gains.values()) < 0.05


def test_training_without_held_out_photos_warns(scene: Scene, tmp_path: Path) -> None:
    events: list[Event] = []
    result = train(
        scene.start, scene.views[:3], QUICK.changed(steps=5, curve_points=1), checkpoints=tmp_path,
        emit=events.append, should_stop=never_stop,
    )  # fmt: skip
    assert result.figures["measured_on"] == "training photos"
    assert any(isinstance(event, Warned) for event in events)


def test_invalid_pixels_do_not_change_the_result(scene: Scene, tmp_path: Path) -> None:
    valid = np.ones((48, 64), bool)
    valid[5:40, 10:30] = False

    def painted(value: int) -> Scene:
        views = []
        for view in scene.views:
            pixels = view.pixels.copy()
            labels = LabelRuns.of(np.where(valid, view.labels.array(), 0).astype(np.int32))
            pixels[~valid] = value
            views.append(replace(view, pixels=pixels, labels=labels, valid=valid))
        return replace(scene, views=views)

    settings = QUICK.changed(coarse_levels=1)
    black, white = run(painted(0), settings, tmp_path / "a"), run(painted(255), settings, tmp_path / "b")
    assert same(black.gaussians, white.gaussians)
    # The errors measured leave it out too, and a photo's loss is not diluted by it.
    assert [(p.psnr, p.ssim, p.l1) for p in black.curve] == [(p.psnr, p.ssim, p.l1) for p in white.curve]
    with pytest.raises(Cancelled):
        run(painted(0), settings, tmp_path / "c", stop=stop_after(25))
    assert same(run(painted(0), settings, tmp_path / "c").gaussians, black.gaussians)
    # Another mask is another run: its checkpoint is not continued.
    assert not same(run(scene, settings, tmp_path / "c").gaussians, black.gaussians)


def test_checkpoints_of_two_other_runs_are_kept(tmp_path: Path) -> None:
    for age, name in enumerate(("new", "middle", "old", "older")):
        (tmp_path / name).mkdir()
        (tmp_path / name / CHECKPOINT_FILE).write_bytes(b"")
        os.utime(tmp_path / name / CHECKPOINT_FILE, (1e9 - age, 1e9 - age))
    (tmp_path / "empty").mkdir()
    assert latest_run(tmp_path) == tmp_path / "new"
    delete_old_runs(tmp_path, keep="older")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["middle", "new", "older"]
    assert latest_run(tmp_path / "nowhere") is None


def test_missing_gaussians_or_photos_are_an_error(scene: Scene, tmp_path: Path) -> None:
    with pytest.raises(TrainingError, match="Gaussians"):
        train(scene.start[:0], scene.views, QUICK, checkpoints=tmp_path, emit=ignore_events, should_stop=never_stop)
    with pytest.raises(TrainingError, match="photo"):
        train(scene.start, [], QUICK, checkpoints=tmp_path, emit=ignore_events, should_stop=never_stop)


def test_inputs_are_not_changed(scene: Scene, tmp_path: Path) -> None:
    before = {f.name: np.copy(getattr(scene.start, f.name)) for f in fields(scene.start)}
    run(scene, QUICK.changed(steps=5, curve_points=1), tmp_path)
    assert all(np.array_equal(getattr(scene.start, name), value) for name, value in before.items())


def paste_transients(scene: Scene) -> tuple[Scene, dict[int, np.ndarray]]:
    """The scene with a dark figure pasted into three of the photos trained on, elsewhere in each."""
    views, truth = list(scene.views), {}
    for place, index in enumerate((1, 5, 9)):
        figure = np.zeros((48, 64), bool)
        figure[14:40, 12 + 14 * place : 20 + 14 * place] = True
        pixels = views[index].pixels.copy()
        pixels[figure] = (10, 90, 20)
        views[index] = replace(views[index], pixels=pixels)
        truth[index] = figure
    return replace(scene, views=views), truth


TRANSIENTS = LONGER.changed(transients=True, train_features=False)


def test_transients_are_found_and_left_out(scene: Scene, tmp_path: Path) -> None:
    with_transients, truth = paste_transients(scene)
    result = run(with_transients, TRANSIENTS, tmp_path / "on")
    found = result.figures["out_of_place"]
    assert sorted(found) == ["01.jpg", "05.jpg", "09.jpg"]
    for index, figure in truth.items():
        # With a margin, but not the whole picture.
        assert figure.mean() < found[f"{index:02d}.jpg"] < 3 * figure.mean()
    without_search = run(with_transients, TRANSIENTS.changed(transients=False), tmp_path / "off")
    assert result.curve[-1].psnr > without_search.curve[-1].psnr + 0.3


def test_photos_without_transients_are_used_completely(scene: Scene, tmp_path: Path) -> None:
    result = run(scene, TRANSIENTS, tmp_path / "on")
    assert result.figures["out_of_place"] == {}
    assert same(result.gaussians, run(scene, TRANSIENTS.changed(transients=False), tmp_path / "off").gaussians)


SHORTER = TRANSIENTS.changed(steps=200, checkpoint_interval=7)


@pytest.fixture(scope="module")
def shorter(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> TrainingResult:
    return run(paste_transients(scene)[0], SHORTER, tmp_path_factory.mktemp("shorter"))


def test_training_without_transients_resumes_exactly(scene: Scene, shorter: TrainingResult, tmp_path: Path) -> None:
    with_transients, _ = paste_transients(scene)
    assert shorter.figures["out_of_place"]
    for steps in (60, 25):
        with pytest.raises(Cancelled):
            run(with_transients, SHORTER, tmp_path, stop=stop_after(steps))
    resumed = run(with_transients, SHORTER, tmp_path)
    assert same(resumed.gaussians, shorter.gaussians)
    assert resumed.figures["out_of_place"] == shorter.figures["out_of_place"]
