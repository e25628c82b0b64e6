"""A damaged checkpoint means that training starts again; it is never an error, and never a wrong result."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from engine.core.errors import Cancelled
from engine.core.events import ignore_events
from engine.scene import Gaussians
from engine.training import AdamState
from engine.training.checkpoint import (
    CHECKPOINT_FILE,
    RunState,
    continues,
    read_checkpoint,
    read_progress,
    write_checkpoint,
)
from engine.training.held_out import CurvePoint
from engine.training.loop import train
from engine.training.parameters import Parameters
from engine.training.settings import PRESETS
from engine.training.trials import Trial

from .conftest import Scene

Arrays = dict[str, np.ndarray]


def state_of(count: int = 6, *, sh_degree: int = 1) -> RunState:
    rng = np.random.default_rng(0)

    def values(*shape: int) -> np.ndarray:
        return rng.normal(size=(count, *shape)).astype(np.float32)

    gaussians = Gaussians(values(3), values(3), values(4), values(), values(4, 3), values(16))
    exposure = torch.zeros(3, 3)
    return RunState(
        Parameters.from_gaussians(gaussians, sh_degree=sh_degree, features=True),
        exposure,
        AdamState.zeros_like(exposure),
        step=20,
        sh_limit=1,
        trials=[Trial("1", 10, 5, 0.3, True)],
        transient_masks={1: np.eye(4, dtype=bool)},
        neighbours=torch.zeros(count, 2, dtype=torch.int32),
        neighbours_step=16,
        curve=[CurvePoint(10, 1.0, 2.0, 20.0, 0.5, 0.1, count), CurvePoint(20, 2.0, 4.0, 21.0, 0.6, 0.1, count)],
        guards=Counter({"reset_rotations": 2}),
        wall_seconds=2.0,
        cpu_seconds=4.0,
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_checkpoint(tmp_path, "key", state_of())
    return tmp_path


def change(folder: Path, edit: Callable[[Arrays, dict[str, Any]], None]) -> None:
    """Change the arrays and the record of the checkpoint, as another program could."""
    with np.load(folder / CHECKPOINT_FILE) as archive:
        arrays = dict(archive)
    record = json.loads(str(arrays.pop("record")))
    edit(arrays, record)
    np.savez(folder / CHECKPOINT_FILE, record=np.array(json.dumps(record)), **arrays)


def test_a_state_is_read_as_written(folder: Path) -> None:
    change(folder, lambda arrays, record: None)
    written, read = state_of(), read_checkpoint(folder, "key")
    assert read is not None
    for name, value in written.parameters.values.items():
        assert torch.equal(read.parameters.values[name], value)
        assert torch.equal(read.parameters.moments[name].square, written.parameters.moments[name].square)
    assert (read.step, read.curve, read.trials, read.guards) == (20, written.curve, written.trials, written.guards)
    assert np.array_equal(read.transient_masks[1], written.transient_masks[1])
    assert read_checkpoint(folder, "another") is None
    progress = read_progress(folder)
    assert progress is not None and progress["step"] == 20 and progress["curve"][-1]["psnr"] == 21.0


def test_an_error_that_could_not_be_measured_survives(tmp_path: Path) -> None:
    state = state_of()
    state.curve[0] = replace(state.curve[0], ssim=float("nan"))
    write_checkpoint(tmp_path, "key", state)
    read = read_checkpoint(tmp_path)
    assert read is not None and np.isnan(read.curve[0].ssim) and read.curve[1] == state.curve[1]


def set_array(name: str, value: np.ndarray) -> Callable[[Arrays, dict[str, Any]], None]:
    return lambda arrays, record: arrays.update({name: value})


def set_value(name: str, value: object) -> Callable[[Arrays, dict[str, Any]], None]:
    return lambda arrays, record: record.update({name: value})


def without(name: str) -> Callable[[Arrays, dict[str, Any]], None]:
    return lambda arrays, record: arrays.__delitem__(name)


ARRAYS = {
    "fewer means": set_array("value.means", np.zeros((5, 3), np.float32)),
    "no Gaussians": set_array("value.means", np.zeros((0, 3), np.float32)),
    "another type": set_array("value.means", np.zeros((6, 3))),
    "not finite": set_array("value.quats", np.full((6, 4), np.nan, np.float32)),
    "moments of another shape": set_array("first.means", np.zeros((6, 4), np.float32)),
    "moments of fewer Gaussians": set_array("second.sh_rest", np.zeros((5, 3, 3), np.float32)),
    "a negative square": set_array("second.means", np.full((6, 3), -1.0, np.float32)),
    "a missing moment": without("first.features"),
    "a missing array": without("value.opacity_logits"),
    "half a band": set_array("value.sh_rest", np.zeros((6, 5, 3), np.float32)),
    "a limit above the stored bands": set_value("sh_limit", 2),
    "a neighbour that does not exist": set_array("neighbours", np.full((6, 2), 6, np.int32)),
    "a negative neighbour": set_array("neighbours", np.full((6, 2), -1, np.int32)),
    "no neighbours": set_array("neighbours", np.zeros((6, 0), np.int32)),
    "an empty mask": set_array("out_of_place.2", np.zeros((0, 4), bool)),
    "a mask of one row": set_array("out_of_place.2", np.zeros(4, bool)),
    "a mask of no photo": set_array("out_of_place.x", np.zeros((4, 4), bool)),
    "a mask of photo 10^5000": set_array("out_of_place." + "9" * 5000, np.zeros((4, 4), bool)),
    "a mask that OpenCV cannot resize": set_array("out_of_place.2", np.zeros((40_000, 1), bool)),
    "text": set_array("value.means", np.array(["a"] * 6)),
}
RECORDS = {
    "another version": set_value("version", 99),
    "a negative step": set_value("step", -1),
    "a step that is no number": set_value("step", "20"),
    "a huge step": set_value("step", 10**30),
    "steps of Adam below 0": lambda arrays, record: record["adam_steps"].update(means=-1),
    "no steps of Adam": set_value("adam_steps", {}),
    "no key": set_value("key", None),
    "a curve that is no list": set_value("curve", {}),
    "a curve in the future": set_value("step", 15),
    "a curve that stands still": lambda arrays, record: record["curve"].append(record["curve"][-1]),
    "an unknown trial": lambda arrays, record: record["trials"][0].update(what="colour"),
    "guards of text": set_value("guards", {"a": "b"}),
    "negative time": set_value("wall_seconds", -1.0),
    "a time that is not finite": set_value("cpu_seconds", float("inf")),
}


@pytest.mark.parametrize("damage", [*ARRAYS, *RECORDS])
def test_values_that_contradict_each_other_start_again(folder: Path, damage: str) -> None:
    change(folder, {**ARRAYS, **RECORDS}[damage])
    assert read_checkpoint(folder, "key") is None and read_checkpoint(folder) is None


@pytest.mark.parametrize("part", [0.0, 0.01, 0.3, 0.6, 0.9, 0.999])
def test_half_a_file_starts_again(folder: Path, part: float) -> None:
    file = folder / CHECKPOINT_FILE
    file.write_bytes(file.read_bytes()[: int(part * file.stat().st_size)])
    assert read_checkpoint(folder) is None and read_progress(folder) is None


@pytest.mark.parametrize("record", ["", "[]", "[" * 100_000, '{"version": 3', '{"step": NaN}', '"\\ud800"'])
def test_a_damaged_record_starts_again(folder: Path, record: str) -> None:
    with np.load(folder / CHECKPOINT_FILE) as archive:
        arrays = {**archive, "record": np.array(record)}
    np.savez(folder / CHECKPOINT_FILE, **arrays)
    assert read_checkpoint(folder) is None and read_progress(folder) is None


def test_a_checkpoint_that_is_a_folder_or_missing_starts_again(tmp_path: Path) -> None:
    assert read_checkpoint(tmp_path) is None and read_progress(tmp_path) is None
    (tmp_path / CHECKPOINT_FILE).mkdir()
    assert read_checkpoint(tmp_path) is None and read_progress(tmp_path) is None


def begun() -> RunState:
    return replace(state_of(), step=0, sh_limit=0, curve=[], transient_masks={}, trials=[])


def test_a_state_continues_the_run_that_it_belongs_to() -> None:
    assert continues(state_of(), begun(), n_steps=100)
    assert continues(state_of(count=9), begun(), n_steps=100), "Gaussians are added while training"


@pytest.mark.parametrize(
    "changes",
    [
        {"step": 101},
        {"step": 100},
        {"exposure": torch.zeros(4, 3)},
        {"sh_limit": None},
        {"transient_masks": {3: np.eye(4, dtype=bool)}},
        {"parameters": state_of(sh_degree=2).parameters},
    ],
    ids=lambda changes: ", ".join(changes),
)
def test_a_state_of_another_run_is_not_continued(changes: dict[str, Any]) -> None:
    assert not continues(replace(state_of(), **changes), begun(), n_steps=100)


def test_a_state_without_the_features_of_the_run_is_not_continued() -> None:
    state = state_of()
    del state.parameters.values["features"]
    assert not continues(state, begun(), n_steps=100)


def test_training_starts_again_from_a_hostile_checkpoint_of_the_same_key(scene: Scene, tmp_path: Path) -> None:
    settings = PRESETS["test"].changed(steps=12, curve_points=2)

    def run(folder: Path, steps: int) -> Gaussians:
        calls = iter(range(steps))
        stop = lambda: next(calls, None) is None  # noqa: E731
        return train(
            scene.start, scene.views, settings, checkpoints=folder, emit=ignore_events, should_stop=stop
        ).gaussians

    whole = run(tmp_path / "whole", 100)
    with pytest.raises(Cancelled):
        run(tmp_path / "hostile", 5)
    # Said to be finished, without a measurement: the result would need the last one.
    change(tmp_path / "hostile", lambda arrays, record: record.update(step=12, curve=[]))
    assert np.array_equal(run(tmp_path / "hostile", 100).means, whole.means)
