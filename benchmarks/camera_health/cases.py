"""The photo sets of the benchmark: sound ones, and spoilt ones with the causes that the health check may name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from engine.cameras.settings import CameraSettings
from engine.core.arrays import Float64

from ..training.photo_sets import REAL_SETS
from .sources import (
    QUICK,
    Change,
    as_it_is,
    box_positions,
    boxes,
    changed,
    cropped,
    doubled,
    given,
    given_by_estimate,
    mirrored,
    original_files,
    positions,
    stretched,
    swapped,
    together,
    zoomed,
)

Write = Callable[[Path], Path | None]
Kind = Literal["sound", "zoom", "swapped", "mirrored", "duplicated", "other"]

_CHOOSING = (
    "museum_room", "room_1", "room_3", "room_5", "room_7", "banana16", "herz_jesus25", "sakharov_statue32",
    *(f"box {seed}" for seed in (1, 3, 4, 5, 6, 9, 11, *range(13, 20))),
)  # fmt: skip
"""Sources on which thresholds may be chosen, with all that is made of them."""


@dataclass(frozen=True)
class PhotoCase:
    """One photo set.

    Attributes
    ----------
    name : str
        Change and source.
    kind : Kind
    source : str
        The set that the photos are from.
    causes : tuple of str
        Causes of `engine.scene.CameraHealth` that name the fault; empty for a sound set.
    write : callable
        Writes the photos to a folder and returns a camera model, or None where cameras are estimated.
    settings : CameraSettings
    positions : dict of str to array of shape [3]
        True positions by photo, where known.
    """

    name: str
    kind: Kind
    source: str
    causes: tuple[str, ...]
    write: Write
    settings: CameraSettings = QUICK
    positions: dict[str, Float64] = field(default_factory=dict)

    @property
    def choosing(self) -> bool:
        """Whether thresholds may be chosen on it."""
        return all(source in _CHOOSING for source in self.source.split(" and "))

    @property
    def is_real(self) -> bool:
        """Whether its photos are of a camera, not generated."""
        return self.source in REAL_SETS


_CAUSES: dict[Kind, str] = {
    "sound": "",
    "zoom": "several_lenses",
    "swapped": "given_cameras",
    "mirrored": "mirrored",
    "duplicated": "repeated several_scenes",
}


def _odd(index: int) -> bool:
    return index % 2 == 1


def _any_corner(index: int, rng: np.random.Generator) -> tuple[float, float]:
    return float(rng.random()), float(rng.random())


def photo_cases() -> list[PhotoCase]:
    """Return all photo sets."""
    cases: list[PhotoCase] = []

    def add(
        kind: Kind, change: str, source: str, write: Write, *, causes: str = "", settings: CameraSettings = QUICK
    ) -> None:
        true = {}
        if source.startswith("box"):
            true = box_positions()
        elif source not in REAL_SETS and " and " not in source:
            true = positions(source)
        named = tuple((causes or _CAUSES[kind]).split())
        cases.append(PhotoCase(f"{change}: {source}", kind, source, named, write, settings, true))

    def add_changed(kind: Kind, change: str, source: str, changes: Change, *, causes: str = "") -> None:
        write = boxes(_seed(source), change=changes) if source.startswith("box") else changed(source, changes)
        add(kind, change, source, write, causes=causes)

    _add_sound(add)
    zooms: list[tuple[str, str, Change]] = [
        ("zoom of every second photo", "museum_room", zoomed(1.0, 1.9)),
        ("three zooms", "room_1", zoomed(1.0, 1.4, 2.2)),
        ("zoom of every second photo", "room_3", zoomed(1.0, 1.6)),
        ("zoom of every third photo", "room_5", zoomed(1.0, 1.0, 2.0)),
        ("zoom of the second half", "room_7", zoomed(*([1.0] * 12), *([1.5] * 12))),
        ("zoom of every second photo", "sakharov_statue32", zoomed(1.0, 1.5)),
        ("zoom of every second photo", "herz_jesus25", zoomed(1.0, 1.6)),
        ("zoom of every third photo", "banana16", zoomed(1.0, 1.0, 1.4)),
        ("zoom of every second photo", "box 1", zoomed(1.0, 1.7)),
        ("zoom of every second photo", "room_2", zoomed(1.0, 1.6)),
        ("zoom of every third photo", "room_4", zoomed(1.0, 1.0, 2.0)),
        ("three zooms", "room_6", zoomed(1.0, 1.4, 2.2)),
        ("zoom of the second half", "room_8", zoomed(*([1.0] * 8), *([1.9] * 8))),
        ("zoom of every second photo", "store_room", zoomed(1.0, 1.5)),
        ("zoom of every second photo", "meeting_place9", zoomed(1.0, 1.6)),
        ("zoom of every third photo", "skull66", zoomed(1.0, 1.0, 1.5)),
        ("zoom of every second photo", "box 2", zoomed(1.0, 1.7)),
    ]
    for change, source, how in zooms:
        add_changed("zoom", change, source, how)

    add("swapped", "two files swapped", "room_3", given("room_3", swapped((2, 9))))
    add("swapped", "order reversed", "museum_room", given("museum_room", lambda n: n[::-1]))
    add("swapped", "neighbours swapped", "room_1", given("room_1", swapped((4, 5), (9, 10))))
    add("swapped", "order shifted by one", "room_5", given("room_5", lambda n: n[1:] + n[:1]))
    add("swapped", "wrong focal length given", "room_5", given("room_5", list, focal=1.3))
    for source, order in (("sakharov_statue32", swapped((2, 6))), ("herz_jesus25", swapped((3, 12)))):
        add("swapped", "two files swapped", source, given_by_estimate(source, order))
    add("swapped", "two files swapped", "room_2", given("room_2", swapped((4, 5))))
    add("swapped", "order shifted by one", "room_6", given("room_6", lambda n: n[1:] + n[:1]))
    add("swapped", "wrong focal length given", "room_4", given("room_4", list, focal=1.5))
    add("swapped", "order reversed", "room_8", given("room_8", lambda n: n[::-1]))
    add("swapped", "three files in a circle", "room_4", given("room_4", swapped((1, 7), (7, 12))))
    add("swapped", "halves swapped", "store_room", given("store_room", lambda n: n[8:] + n[:8]))
    add("swapped", "two files swapped", "meeting_place9", given_by_estimate("meeting_place9", swapped((1, 6))))

    flips: list[tuple[str, str, Change]] = [
        ("mirrored half", "museum_room", mirrored(lambda i: i >= 8)),
        ("mirrored, three photos", "room_5", mirrored(lambda i: i in (3, 7, 8))),
        ("mirrored, every second photo", "room_1", mirrored(_odd)),
        ("mirrored half", "room_3", mirrored(lambda i: i < 8)),
        ("mirrored half", "sakharov_statue32", mirrored(lambda i: i < 8)),
        ("mirrored, every second photo", "herz_jesus25", mirrored(_odd)),
        ("mirrored, three photos", "banana16", mirrored(lambda i: i in (2, 5, 6))),
        ("mirrored, every second photo", "room_2", mirrored(_odd)),
        ("mirrored half", "room_4", mirrored(lambda i: i < 8)),
        ("mirrored, three photos", "room_6", mirrored(lambda i: i in (3, 7, 8))),
        ("mirrored, one photo", "room_8", mirrored(lambda i: i == 6)),
        ("mirrored half", "store_room", mirrored(lambda i: i >= 8)),
        ("mirrored, three photos", "meeting_place9", mirrored(lambda i: i in (2, 3, 6))),
        ("mirrored half", "skull66", mirrored(lambda i: i >= 8)),
    ]
    for change, source, how in flips:
        add_changed("mirrored", change, source, how)

    for seed in (3, 4, 5, *range(13, 16), *range(21, 29)):
        add("duplicated", "duplicated wall", f"box {seed}", boxes(seed, same_walls=True))
    _add_others(add, add_changed)
    return cases


def _seed(source: str) -> int:
    return int(source.split()[1])


def _add_sound(add: Callable[..., None]) -> None:
    """Add the sound sets: the real ones whole, as files and with settings that a user has."""
    for name in ("museum_room", "store_room", *(f"room_{seed}" for seed in range(1, 9))):
        add("sound", "sound", name, changed(name, as_it_is))
    for name in sorted(REAL_SETS):
        add("sound", "sound", name, original_files(name), settings=CameraSettings())
    for name in ("room_1", "museum_room", "store_room"):
        add("sound", "sound, given cameras", name, given(name, list))
    for seed in (1, 2, 16, 17, 18, 30, 31):
        add("sound", "sound", f"box {seed}", boxes(seed))


def _add_others(add: Callable[..., None], add_changed: Callable[..., None]) -> None:
    """Add sets that are spoilt in other ways than by zoom, names, mirrors and equal walls."""
    add_changed("other", "read as 8 bits, doubled", "museum_room", doubled, causes="stretched unclear")
    add_changed("other", "read as 8 bits, doubled", "room_4", doubled, causes="stretched unclear")
    every = stretched(1.33, lambda i: True)
    add_changed("other", "stretched 1.33 times, all", "room_1", every, causes="stretched")
    half = stretched(1.33, _odd)
    add_changed("other", "stretched 1.33 times, half", "room_6", half, causes="stretched several_lenses")
    less = stretched(1.2, lambda i: True)
    add_changed("other", "stretched 1.2 times, all", "sakharov_statue32", less, causes="stretched")

    for seed in (6, 7):
        write = boxes(seed, "panorama", size=(800, 400), radius=1.0)
        add("other", "panoramas", f"box {seed}", write, causes="panorama")
    write = boxes(8, "panorama", size=(800, 400), radius=1.0, cut=0.2)
    add("other", "panoramas without their poles", "box 8", write, causes="panorama")
    add("other", "fisheye", "box 9", boxes(9, "fisheye", focal=230.0), causes="fisheye")
    add("other", "fisheye", "box 10", boxes(10, "fisheye", focal=260.0, size=(600, 600)), causes="fisheye")

    for first, second, counts in (
        ("museum_room", "sakharov_statue32", (8, 8)),
        ("room_2", "room_8", (8, 8)),
        ("room_6", "banana16", (11, 5)),
    ):
        write = together(first, second, counts)
        add("other", "two scenes", f"{first} and {second}", write, causes="several_scenes")

    anywhere = cropped(0.6, _any_corner)
    add_changed("other", "cropped anywhere", "museum_room", anywhere, causes="cropped")
    add_changed("other", "cropped anywhere", "room_8", anywhere, causes="cropped")
    to_a_side = cropped(0.65, lambda i, _: (float(i % 2), 0.5))
    add_changed("other", "cropped to a side, half", "room_3", to_a_side, causes="cropped")
    to_the_left = cropped(0.6, lambda i, _: (0.0, 0.0))
    add_changed("other", "cropped to the left, all", "room_2", to_the_left, causes="cropped")

    for seed in (11, 12):
        write = boxes(seed, radius=0.0, turn=0.0, focal=300.0)
        add("other", "turned on one place", f"box {seed}", write, causes="one_place")
