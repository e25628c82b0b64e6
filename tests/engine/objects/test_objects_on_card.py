"""Objects that are isolated with views and votes of a graphics card are those of the processor."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from engine.core.events import Event, Progress, Warned
from engine.objects.prompts import ClickPrompt, TextPrompt
from engine.objects.segment import find_everything, find_objects
from engine.objects.settings import BETTER
from engine.rasterizer import PROCESSOR, Device
from engine.rasterizer.gpu import Gpu
from tests.engine.objects.fakes import segmenter_of, trained_project
from tests.engine.pictures.blob_scene import BLUE, BlobScene

SMALL = replace(BETTER, photo_side=160, render_side=160, detail_steps=3)
CARD = Device("gpu", "card")

SAME = 0.999
"""Share of the Gaussians that must be in both objects or in none.

Votes differ by rounding, and a Gaussian whose votes are balanced may fall on either side of one half.
"""


def assert_same_object(found: np.ndarray, expected: np.ndarray) -> None:
    assert expected.any() and np.mean(found == expected) >= SAME


@pytest.mark.parametrize("prompt", ["click", "text", "all"])
def test_objects_are_those_of_the_processor(prompt: str, card: Gpu, blobs: BlobScene, tmp_path: Path) -> None:
    found = []
    for device in (CARD, PROCESSOR):
        project = trained_project(blobs, tmp_path / device.name)
        context = segmenter_of(project, blobs, SMALL, device=device).context
        assert context.views.scene.backend == device.backend
        if prompt == "all":
            found.append([one.members for one in find_everything(context)])
            continue
        click = ClickPrompt("view_1.png", *blobs.center_of(BLUE, "view_1.png"))
        asked = click if prompt == "click" else TextPrompt("red ball")
        objects = find_objects(context, asked)
        found.append([one.membership >= 0.5 for one in objects])
        for one in objects:
            found[-1] += [level >= 0.5 for level in one.levels.memberships]
    assert len(found[0]) == len(found[1]) > 0
    for ours, expected in zip(*found, strict=True):
        assert_same_object(ours, expected)


def test_events_tell_the_device_and_that_the_processor_replaces_it(
    card: Gpu, blobs: BlobScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project, events = trained_project(blobs, tmp_path), list[Event]()
    monkeypatch.setattr("engine.rasterizer.gpu.workspace.free_memory", lambda: 10_000)
    context = segmenter_of(project, blobs, SMALL, device=CARD, emit=events.append).context
    assert context.views.of(context.views.cameras.cameras[0]).features.any()
    told, warned = events
    assert isinstance(told, Progress) and told.message == "rendering on card"
    assert isinstance(warned, Warned)
    assert warned.message.startswith("The rest is rendered on the processor, because this scene of 950 Gaussians needs")
