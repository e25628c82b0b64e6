"""A computer with or without a card, which reconstructs the museum."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

import engine.training
from engine.training.card_settings import CARD_SIZES, CardSizes
from tests.engine.command_line import Answer, call
from tests.engine.museum import VIEWS, write_cameras, write_photos

REASON = "this computer has no graphics card"
CARD = {"backend": "gpu", "name": "Card (Vulkan)", "max_buffer_bytes": 2 << 30, "memory": 8 << 30}


@dataclass
class Computer:
    """A computer with or without a card, on which a photo folder is reconstructed."""

    command: list[object]
    scene: Path
    capsys: pytest.CaptureFixture[str]
    card: dict[str, Any] | None = None
    looked: int = 0
    backends: list[str] = field(default_factory=list)
    train: Callable[..., Any] = engine.training.train

    def find(self, *_: object, **__: object) -> dict[str, Any]:
        """Answer in place of the child process that tests the card."""
        self.looked += 1
        return self.card or {"reason": REASON}

    def train_here(self, start: Any, views: Any, settings: Any, **more: Any) -> Any:
        """Train on the processor, whichever device is asked for: there is no card."""
        self.backends.append(settings.backend)
        return self.train(start, views, settings.changed(backend="cpu"), **more)

    def run(self, *more: object) -> Answer:
        """Reconstruct."""
        return call(self.capsys, *self.command, *more)

    def stored(self) -> dict[str, Any]:
        """Return ``project.json``."""
        values: dict[str, Any] = json.loads((self.scene / "project.json").read_text(encoding="utf-8"))
        return values


@pytest.fixture
def computer(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Computer:
    photos, scene = write_photos(tmp_path / "photos"), tmp_path / "scene"
    cameras = write_cameras(tmp_path, {f"view_{view:02}.jpg": view for view in VIEWS})
    command: list[object] = ["reconstruct", photos, "--out", scene, "--preset", "test", "--no-objects"]
    made = Computer([*command, "--cameras", cameras], scene, capsys)
    monkeypatch.setattr("engine.rasterizer.devices.run_in_child", made.find)
    monkeypatch.setattr("engine.training.train", made.train_here)
    monkeypatch.setitem(CARD_SIZES, "test", CardSizes(50, 0, 48, 500))
    return made
