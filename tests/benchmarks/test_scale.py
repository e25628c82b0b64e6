"""The generated building is photographed by the cameras that are told, and its table says what was measured."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.scale.building import FOCAL, HEIGHT, PHOTOS_PER_ROOM, WIDTH, Building
from benchmarks.scale.measuring import STEPS
from benchmarks.scale.table import scale_table


def test_same_place_of_the_floor_has_the_same_colour_in_two_photos() -> None:
    building = Building(3)
    first, second = building.cameras(2)
    pixels = np.stack(np.meshgrid(np.arange(20, WIDTH, 9), np.arange(HEIGHT - 120, HEIGHT, 9)), axis=-1).reshape(-1, 2)
    center = -first[:3, :3].T @ first[:3, 3]
    middle = np.array([WIDTH, HEIGHT]) / 2
    rays = np.concatenate([(pixels + 0.5 - middle) / FOCAL, np.ones((len(pixels), 1))], axis=1) @ first[:3, :3]
    floor = center - rays * (center[2] / rays[:, 2:])
    local = floor @ second[:3, :3].T + second[:3, 3]
    at = np.floor(local[:, :2] / local[:, 2:] * FOCAL + middle).astype(int)
    seen = (local[:, 2] > 0) & (at >= 0).all(axis=1) & (at < (WIDTH, HEIGHT)).all(axis=1)
    assert seen.sum() > 50
    colours = building.picture(first)[pixels[seen, 1], pixels[seen, 0]].astype(int)

    def difference(photo: NDArray[np.uint8]) -> float:
        return float(np.median(np.abs(colours - photo[at[seen, 1], at[seen, 0]])))

    # Cases hide the floor in some places, and elsewhere the pixel of the other photo may lie half a pixel away: 17 of
    # 255 when this was written. A photo of another place differs by much more.
    assert difference(building.picture(second)) < 25
    assert difference(building.picture(building.cameras(5)[4])) > 40


def test_walk_of_more_photos_begins_with_that_of_fewer_and_leaves_no_room() -> None:
    building = Building(3)
    cameras = building.cameras(6 * PHOTOS_PER_ROOM)
    np.testing.assert_array_equal(building.cameras(30), cameras[:30])
    centers = np.array([-one[:3, :3].T @ one[:3, 3] for one in cameras])
    rooms = np.floor(centers[:, :2] / (6.0, 5.0)).astype(int)
    # A photo on the way to the next room may stand in it already.
    assert {tuple(room) for room in rooms.tolist()} == {(0, 0), (1, 0), (2, 0), (3, 0), (4, 0), (4, 1), (3, 1)}
    assert (centers[:, 2] < 2.0).all() and (centers[:, 2] > 1.0).all()


def test_table_tells_time_by_step_errors_and_growth() -> None:
    def result(count: int, seconds: float) -> dict[str, object]:
        steps = dict.fromkeys(STEPS, seconds)
        return {
            "name": f"building_{count}", "cores": 2, "machine": "a computer",
            "n_photos": count, "n_placed": count - 1, "median_error": 0.0005, "largest_error": 0.002, "n_pairs": 200,
            "n_verified": 150, "error_px": 0.25, "wall": steps, "cpu": steps, "peak_bytes": 400_000_000,
        }  # fmt: skip

    text = scale_table([result(100, 8.0), result(50, 2.0)])
    rows = [line for line in text.splitlines() if line.startswith("| building")]
    assert [row.split(" | ")[0] for row in rows] == ["| building_50", "| building_100"]
    assert "99 of 100 | 0.050, 0.200 | 0.25 | 400 |" in rows[1]
    # Twice the photos, four times the seconds.
    assert "n^2.00 in wall time and n^2.00 in CPU time" in text
