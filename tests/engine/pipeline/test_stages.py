"""A stage of the pipeline does not end when a graphics card fails."""

from __future__ import annotations

import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.core.child_process import ChildFailure
from engine.core.events import Event, Warned, never_stop
from engine.masks import label_map_path
from engine.masks.settings import MaskSettings
from engine.masks.storage import write_label_map
from engine.pipeline.runner import StageRunner
from engine.pipeline.stages import masks_stage
from engine.project.folder import ProjectFolder

NAME = "a.jpg"
CRASH = ChildFailure("Encoding a photo on the graphics card crashed (SIGSEGV).", "crash")


@pytest.mark.parametrize("answer", [CRASH, (True, "The card encodes photos.")], ids=["crash", "card-works"])
def test_card_whose_driver_crashes_is_not_used_for_masks_and_that_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answer: Any
) -> None:
    def in_child(*_: object, **__: object) -> object:
        if isinstance(answer, Exception):
            raise answer
        return answer

    asked: list[bool] = []

    def load_sam(name: str, *, threads: int, may_use_gpu: bool) -> None:
        asked.append(may_use_gpu)

    def make_masks(*given: Any, **_: object) -> dict[str, Path]:
        load = given[-1]
        load()
        path = label_map_path(tmp_path / "project" / "masks", NAME)
        write_label_map(path, np.ones((4, 5), np.int32))
        return {NAME: path}

    monkeypatch.setattr("engine.install.models.onnx_session.gpu_provider_is_installed", lambda: True)
    monkeypatch.setattr("engine.masks.encoder.gpu_provider_is_installed", lambda: True)
    monkeypatch.setattr("engine.masks.encoder.run_in_child", in_child)
    monkeypatch.setattr("engine.masks.sam.load_sam", load_sam)
    monkeypatch.setattr("engine.masks.stage.make_masks", make_masks)
    photos: Any = types.SimpleNamespace(photos=[types.SimpleNamespace(name=NAME, sha256="0" * 64)])
    plan: Any = types.SimpleNamespace(mask_photos=(NAME,))
    events: list[Event] = []
    with ProjectFolder.create(tmp_path / "project") as project:
        runner = StageRunner(project, events.append, never_stop)
        masks_stage(runner, photos, plan, MaskSettings())
    warnings = [event.message for event in events if isinstance(event, Warned)]
    if isinstance(answer, Exception):
        assert asked == [False]
        assert warnings == [
            "Photos are encoded on the CPU: Encoding a photo on the graphics card crashed (SIGSEGV); update its driver."
        ]
    else:
        assert asked == [True] and warnings == []
