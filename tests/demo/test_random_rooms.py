"""Random rooms: the same seed describes the same room, and every seed a valid one. Nothing is rendered here."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.cameras.model_reading import read_model
from engine.core.events import never_stop

SEEDS = range(16)
"""With so few, all kinds but one are shown, and things that stand in others and equal twins among them."""


@pytest.fixture(scope="session")
def rooms() -> dict[int, Any]:
    from random_rooms.plan import draw_room

    return {seed: draw_room(seed) for seed in SEEDS}


def test_the_same_seed_describes_the_same_room(rooms: dict[int, Any]) -> None:
    from random_rooms.plan import draw_room

    assert draw_room(0).fingerprint() == rooms[0].fingerprint()
    assert draw_room(1, attempt=1).fingerprint() != rooms[1].fingerprint()
    assert len({room.fingerprint() for room in rooms.values()}) == len(rooms)


def test_a_seed_may_be_as_large_as_a_hash() -> None:
    from random_rooms.plan import draw_room

    seed = 2**256 - 12345
    assert draw_room(seed).fingerprint() == draw_room(seed).fingerprint() != draw_room(seed - 1).fingerprint()


def test_rooms_have_6_to_14_exhibits_of_the_catalogue_and_24_photos(rooms: dict[int, Any]) -> None:
    from random_rooms.catalogue import KIND_OF

    assert len(KIND_OF) >= 20
    shown = set()
    for room in rooms.values():
        assert 6 <= len(room.exhibits) <= 14
        assert len(room.views) == 24
        assert {one.prompt for one in room.exhibits} <= set(KIND_OF)
        shown |= {one.prompt for one in room.exhibits}
    assert len(shown) >= 0.9 * len(KIND_OF)


def test_nothing_intersects_and_nothing_floats(rooms: dict[int, Any]) -> None:
    for seed, room in rooms.items():
        things = [*room.exhibits, *room.furniture]
        # 1 mm: things touch what they stand on.
        boxes = {one.name: one.box.grown(-0.001, -0.001) for one in things if not one.within}
        crossing = [(a, b) for a, b in combinations(boxes, 2) if boxes[a].intersects(boxes[b])]
        assert crossing == [], seed
        for one in things:
            held = one.box.bottom < 0.001 or is_on_wall(one, room) or one.within or stands_on_something(one, things)
            assert held, (seed, one.name)
            assert np.abs(one.box.corners[:, 0]).max() <= room.dimensions.half_width, (seed, one.name)
            assert one.box.corners[:, 1].max() <= room.dimensions.back, (seed, one.name)


def is_on_wall(one: Any, room: Any) -> bool:
    size, corners = room.dimensions, one.box.corners
    gaps = (size.half_width - np.abs(corners[:, 0]).max(), size.back - np.abs(corners[:, 1]).max())
    return one.turn % 90 == 0 and min(gaps) < 0.01


def stands_on_something(one: Any, things: list[Any]) -> bool:
    """Return whether a box touches a lower one from above; the middle of its footprint is over that one."""
    middle = np.array([[one.box.x, one.box.y, one.box.bottom]])
    return any(other is not one and other.box.grown(0, 0.002).contains(middle)[0] for other in things)


def test_an_exhibit_inside_another_one_is_seen_above_its_rim(rooms: dict[int, Any]) -> None:
    pairs = 0
    for seed, room in rooms.items():
        for one in room.exhibits:
            if one.within:
                outer = next(other for other in room.exhibits if other.exhibit == one.owner)
                cavity = outer.thing.cavity
                assert one.box.bottom == pytest.approx(outer.where[2] + cavity.floor), (seed, one.name)
                assert one.box.top > outer.where[2] + cavity.rim, (seed, one.name)
                pairs += 1
    assert pairs >= len(rooms) // 10


def test_equal_twins_share_shape_and_prompt(rooms: dict[int, Any]) -> None:
    twins = 0
    for room in rooms.values():
        for a, b in combinations(room.exhibits, 2):
            if a.prompt == b.prompt:
                twins += 1
                assert a.thing is b.thing and a.name != b.name and a.where != b.where
    assert twins >= len(rooms) // 5


def test_cameras_keep_away_from_things_and_stay_in_the_room(rooms: dict[int, Any]) -> None:
    from random_rooms.sight import eye_of

    for seed, room in rooms.items():
        eyes = np.array([eye_of(view) for view in room.views])
        assert np.abs(eyes[:, 0]).max() < room.dimensions.half_width - 0.1, seed
        assert eyes[:, 1].max() < room.dimensions.back - 0.1, seed
        for one in (*room.exhibits, *room.furniture):
            assert not one.box.grown(0.1, 0.1).contains(eyes).any(), (seed, one.name)
        assert max(abs(view.exposure) for view in room.views) <= 0.25


def test_a_box_hides_what_is_behind_it_and_intersects_what_it_touches() -> None:
    from random_rooms.boxes import Box, hidden

    box = Box(0, 0, 0, 1, 0.5, 0.1, turn=90)
    assert box.intersects(Box(0.25, 0.8, 0, 1, 0.2, 0.25)) is False
    assert box.intersects(Box(0.25, 0.4, 0, 1, 0.2, 0.25)) is True
    assert box.intersects(Box(0, 0, 1, 2, 0.5, 0.5)) is False
    points = np.array([[1.0, 0.0, 0.5], [1.0, 0.0, 1.8], [1.0, 1.5, 0.5], [-0.5, 0.0, 0.5], [1.0, 0.0, 0.5]])
    found = hidden(np.array([-1.0, 0.0, 0.5]), points, np.array([1, 1, 1, 1, 0]), [box], np.array([0]))
    # Behind it; above it; beside it; before it; behind it, but of its own thing.
    assert found.tolist() == [True, False, False, False, False]


def test_names_tell_exhibits_from_furniture(rooms: dict[int, Any]) -> None:
    for room in rooms.values():
        names = room.named()
        exhibits = {int(number) for number, entry in names.items() if "ignore" not in entry}
        ignored = {int(number) for number, entry in names.items() if entry.get("ignore") is True}
        assert exhibits == set(range(1, len(room.exhibits) + 1))
        assert max(exhibits) < min(ignored) and max(ignored) < 256
        assert len({entry["name"] for entry in names.values()}) == len(names)


def test_absent_words_name_nothing_in_the_room_and_nothing_like_it(rooms: dict[int, Any]) -> None:
    from random_rooms.catalogue import EVERYDAY, KIND_OF

    for seed, room in rooms.items():
        shown = {entry["prompt"] for entry in room.named().values()}
        assert len(room.absent) == len(set(room.absent)) == 10
        assert sum(word in EVERYDAY for word in room.absent) == 4
        for word in room.absent:
            assert word not in shown, seed
            if word in KIND_OF:
                assert not shown & set(KIND_OF[word].like), (seed, word)
                assert not any(word in KIND_OF[name].like for name in shown if name in KIND_OF), (seed, word)


def test_similar_kinds_are_kinds_or_furniture() -> None:
    from random_rooms.catalogue import EVERYDAY, KIND_OF

    furniture = {"bench", "stool", "banner", "information panel"}
    for kind in KIND_OF.values():
        assert set(kind.like) <= set(KIND_OF) | furniture, kind.name
    assert not set(EVERYDAY) & set(KIND_OF)


def test_every_kind_stands_on_its_base_or_hangs_on_its_wall() -> None:
    from random_rooms.catalogue import KINDS

    for number, kind in enumerate(KINDS):
        for draw in range(3):
            thing = kind.draw(np.random.default_rng((number, draw)))
            again = kind.draw(np.random.default_rng((number, draw)))
            vertices = np.concatenate([part.shape.vertices for part in thing.parts])
            assert np.isfinite(vertices).all()
            # Tolerance: rounding of float64 sums.
            assert np.allclose(vertices.min(axis=0), thing.low, atol=1e-9), kind.name
            assert np.allclose(vertices.max(axis=0), thing.high, atol=1e-9), kind.name
            base = thing.high[1] if kind.mount == "wall" else thing.low[2]
            assert base == pytest.approx(0, abs=1e-9), kind.name
            assert 0.08 < max(thing.size) < 1.6, kind.name
            assert all(part.shape.quads.max() < len(part.shape.vertices) for part in thing.parts)
            assert [part.stuff for part in again.parts] == [part.stuff for part in thing.parts]


def test_every_pattern_is_painted_the_same_from_the_same_seed() -> None:
    from random_rooms.pictures import PATTERNS, paint

    for pattern in PATTERNS:
        picture = paint(pattern, ("#336699", "#112233", "#aa8844", "#eeddcc"), 5, (120, 180))
        assert picture.shape == (120, 180, 3) and picture.dtype == np.uint8
        assert np.array_equal(picture, paint(pattern, ("#336699", "#112233", "#aa8844", "#eeddcc"), 5, (120, 180)))
        assert np.ptp(picture) > 20, pattern


def test_a_folder_of_another_seed_is_refused_in_one_sentence(tmp_path: Path) -> None:
    from random_rooms.outputs import OtherRoomError, accepted_attempt

    assert accepted_attempt(tmp_path, 3) is None
    (tmp_path / "truth").mkdir()
    known = tmp_path / "truth" / "room.json"
    known.write_text('{"seed": 3, "attempt": 2}', encoding="utf-8")
    assert accepted_attempt(tmp_path, 3) == 2
    with pytest.raises(OtherRoomError, match=r"holds the room of seed 3, not of 4; choose another --out\.$"):
        accepted_attempt(tmp_path, 4)
    known.write_text("[]", encoding="utf-8")
    with pytest.raises(OtherRoomError, match="damaged"):
        accepted_attempt(tmp_path, 3)


def test_a_room_is_complete_when_its_last_file_is_there(tmp_path: Path) -> None:
    from random_rooms.outputs import is_complete

    files = ["truth/names.json", "truth/absent.json", "photos/view_00.jpg", "truth/masks/view_00.png"]
    files += [f"cameras/{name}.txt" for name in ("cameras", "images", "points3D")]
    for name in ("truth/cameras.json", *files):
        assert not is_complete(tmp_path)
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text('{"photos": [{"file": "view_00.jpg"}]}', encoding="utf-8")
    assert is_complete(tmp_path)


def test_the_engine_reads_the_true_cameras(rooms: dict[int, Any], tmp_path: Path) -> None:
    from random_rooms.colmap_text import model_files
    from random_rooms.plan import PHONE

    for room in (rooms[1], rooms[2]):
        for name, text in model_files(room.views, PHONE).items():
            (tmp_path / name).write_text(text, encoding="utf-8")
        images, points = read_model(tmp_path, never_stop)
        assert len(points.positions) == 0
        for view, image in zip(room.views, sorted(images, key=lambda image: image.name), strict=True):
            assert image.name == f"{view.name}.jpg"
            # Numbers in the file have 12 digits.
            assert np.allclose(image.viewmat, view.world_to_camera, atol=1e-9)
            model, width, height, params = image.lens
            assert (model, width, height) == ("SIMPLE_RADIAL", 480, 360)
            assert params == pytest.approx((PHONE.focal, *PHONE.centre, PHONE.k1))
