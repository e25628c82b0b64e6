"""When memory is full, the user reads one sentence, whichever library ran out, and the project continues later."""

from __future__ import annotations

import errno
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from engine.cli.commands import doctor
from engine.core.errors import is_out_of_memory
from engine.project.folder import ProjectFolder
from engine.quality.stability.memory_limit import MALLOC_ENVIRONMENT
from engine.training.checkpoint import CHECKPOINT_FILE
from engine.training.settings import PRESETS
from tests.engine.command_line import call, call_alone
from tests.engine.museum import VIEWS, write_cameras, write_photos

# Photos large enough that each step needs memory from the system.
LARGER = {"max_side": 192, "checkpoint_interval": 5}

STARVING = (
    f"larger = {LARGER}"
    + """
from engine.core.system import limit_memory
from engine.training import loop as module
from engine.training.settings import PRESETS
PRESETS["test"] = PRESETS["test"].changed(**larger)
whole = module.train
def starving(*arguments, should_stop, **named):
    asked = iter(range(10**9))
    def ask():
        if next(asked) == 12:
            limit_memory(0)
        return should_stop()
    return whole(*arguments, should_stop=ask, **named)
module.train = starving
"""
)


def too_much_of(library: str) -> None:
    """Ask a library for a million gigabytes."""
    if library == "numpy":
        np.empty(10**15, np.uint8)
    else:
        torch.empty(10**15, dtype=torch.uint8)


@pytest.mark.parametrize("library", ["numpy", "torch"])
def test_each_library_s_way_to_be_out_of_memory_is_known(library: str) -> None:
    with pytest.raises((MemoryError, RuntimeError)) as caught:
        too_much_of(library)
    assert is_out_of_memory(caught.value)


def test_other_errors_are_not_taken_for_it() -> None:
    for error in (
        RuntimeError("shapes differ"),
        OSError(errno.ENOSPC, "No space left on device"),
        ValueError("memory"),
    ):
        assert not is_out_of_memory(error)


@pytest.mark.parametrize(
    "error", [MemoryError(), OSError(errno.ENOMEM, "Cannot allocate memory"), RuntimeError("can't start new thread")]
)
def test_any_command_that_runs_out_of_memory_says_so(
    error: Exception, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(*_: object) -> int:
        raise error

    monkeypatch.setattr(doctor, "run", run)
    answer = call(capsys, "doctor")
    assert answer.code == 1
    assert "memory of this machine is full" in answer.error


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux keeps a limit on a process")
def test_project_goes_on_where_memory_ran_out_while_training(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, value in MALLOC_ENVIRONMENT.items():
        monkeypatch.setenv(name, value)
    photos, scene = write_photos(tmp_path / "photos"), tmp_path / "scene"
    (tmp_path / "cameras").mkdir()
    cameras = write_cameras(tmp_path / "cameras", {f"view_{view:02}.jpg": view for view in VIEWS})
    command = ["reconstruct", photos, "--out", scene, "--cameras", cameras, "--preset", "test", "--no-objects"]
    starved = call_alone(*command, before=STARVING)
    assert starved.code == 1
    assert "memory of this machine is full" in starved.error
    assert not (scene / "gaussians" / "scene.ply").exists()
    assert len(list(scene.glob(f"checkpoints/*/{CHECKPOINT_FILE}"))) == 1
    monkeypatch.setitem(PRESETS, "test", PRESETS["test"].changed(**LARGER))
    again = call(capsys, *command)
    assert again.code == 0
    assert "photos" not in again.computed and "cameras" not in again.computed
    assert any("continued" in event.get("message", "") for event in again.of_kind("progress"))
    assert ProjectFolder.open_existing(scene).stage_record("training") is not None
