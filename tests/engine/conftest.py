"""What the tests of several rooms share."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from engine.cli.main import main
from engine.core.system import describe_machine
from engine.pipeline.planning.benchmark import calibrate
from engine.pipeline.planning.calibration import CALIBRATION_VARIABLE, REFERENCE
from tests.engine.museum import VIEWS, write_cameras, write_photos
from tests.engine.pictures.blob_scene import BlobScene, make_scene

if TYPE_CHECKING:
    from engine.rasterizer.gpu import Gpu


@pytest.fixture(scope="session")
def blobs() -> BlobScene:
    """The blob scene, made once."""
    return make_scene()


@pytest.fixture(scope="session", autouse=True)
def _no_graphics_card() -> Iterator[None]:
    """Commands of tests train on the processor, also on a computer with a card, and do not look for one."""
    answer = {"reason": "tests use no graphics card", "found": "none"}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("engine.rasterizer.devices.run_in_child", lambda *_, **__: answer)
        yield


@pytest.fixture
def card(monkeypatch: pytest.MonkeyPatch) -> Gpu:
    """Let all that renders, and the commands that isolate objects, take a software adapter for a graphics card."""
    from engine.rasterizer import Device

    from .cards import card_or_skip

    gpu = card_or_skip()
    monkeypatch.setattr("engine.rasterizer.gpu.open_gpu", lambda: gpu)
    answer = asdict(
        Device(
            "gpu", f"{gpu.name} ({gpu.backend})", found=gpu.name, max_buffer_bytes=gpu.max_binding_bytes,
            shares_memory=gpu.shares_memory,
        )
    )  # fmt: skip
    monkeypatch.setattr("engine.rasterizer.devices.run_in_child", lambda *_, **__: answer)
    return gpu


@pytest.fixture(scope="session", autouse=True)
def _speed_of_the_reference_machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Forecasts of tests neither measure this machine nor change what its user's forecasts are made from."""
    before = os.environ.get(CALIBRATION_VARIABLE)
    os.environ[CALIBRATION_VARIABLE] = str(tmp_path_factory.mktemp("calibration") / "calibration.json")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("engine.pipeline.planning.benchmark.measure_speed", lambda: REFERENCE)
        calibrate(describe_machine(), emit=lambda event: None)
    yield
    if before is None:
        del os.environ[CALIBRATION_VARIABLE]
    else:
        os.environ[CALIBRATION_VARIABLE] = before


@pytest.fixture(scope="session")
def _kept_museum(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with photos, ``transforms.json`` and the ``scene`` that was made of them; a copy lies beside it."""
    folder = tmp_path_factory.mktemp("museum") / "museum"
    photos = write_photos(folder / "photos")
    cameras = write_cameras(folder, {f"view_{view:02}.jpg": view for view in VIEWS})
    command = [
        "reconstruct",
        photos,
        "--out",
        folder / "scene",
        "--preset",
        "test",
        "--cameras",
        cameras,
        "--no-objects",
    ]
    assert main([str(word) for word in command]) == 0
    shutil.copytree(folder, folder.with_name("kept"))
    return folder


@pytest.fixture
def museum(_kept_museum: Path) -> Path:
    """The folder of `_kept_museum` as it was, for a test to change; at the place that its project remembers."""
    shutil.rmtree(_kept_museum)
    return Path(shutil.copytree(_kept_museum.with_name("kept"), _kept_museum))
