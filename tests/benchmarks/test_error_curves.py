"""Errors against seconds are told by device, and the gallery's points lie on what its photos show."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.scale.building import FOCAL, HEIGHT, WIDTH, Building
from benchmarks.training.error_curves import error_plot, error_table, sets_table
from engine.core.arrays import Float64


def result(run: str, seconds: float, psnr: float, **ours: Any) -> dict[str, Any]:
    figures = {"psnr": psnr, "fitted_psnr": psnr + 1, "wall_seconds": seconds, "n_gaussians": 40_000, "curve": []}
    return {"set": "museum_room", "run": run, "seed": 0, "figures": figures | ours}


RESULTS = [
    result("gsplat:3000:100000", 16, 28.6),
    result("8 cores:standard", 150, 29.6, steps=3000, cpu_seconds=400.0),
    result("best:rounds=100", 12, 31.0, steps=4200, cpu_seconds=14.0),
    result("standard", 6, 30.2, steps=3000, cpu_seconds=7.0, curve=[{"wall_seconds": 3.0, "psnr": 28.0}]),
]


def test_rows_are_by_device_and_seconds_with_gsplat_last() -> None:
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in error_table(RESULTS).split("\n")[2:]]
    assert [row[1:4] for row in rows] == [
        ["card", "`standard`", "3,000"],
        ["card", "`best`, rounds=100", "4,200"],
        ["processor, 8 cores", "`standard`", "3,000"],
        ["gsplat", "", "3,000"],
    ]
    assert rows[0][5:] == ["30.20", "31.20", "6.0", "7"] and rows[3][5:] == ["28.60", "29.60", "16.0", ""]


def test_a_set_is_a_row_with_means_over_the_seeds_of_each_run() -> None:
    rows = [line.split(" | ") for line in sets_table([*RESULTS, result("standard", 7, 30.6)]).split("\n")]
    assert rows[0] == [
        "| set", "card: `standard`", "card: `best`, rounds=100", "processor, 8 cores: `standard`",
        "gsplat: 3000:100000 |",
    ]  # fmt: skip
    assert rows[2] == ["| museum_room", "30.40 (31.40), 2", "31.00 (32.00)", "29.60 (30.60)", "28.60 (29.60) |"]


def test_trainings_without_a_curve_are_drawn_too() -> None:
    assert error_plot(RESULTS).startswith(b"\x89PNG")


def test_a_place_of_the_gallery_has_its_colour_in_the_next_photo_too() -> None:
    building = Building(0)
    first, second = building.cameras(2)
    picture, depth = building.seen(first.astype(np.float32))
    other, other_depth = building.seen(second.astype(np.float32))
    x, y = (part.ravel() for part in np.meshgrid(np.arange(5, WIDTH, 9), np.arange(5, HEIGHT, 9)))
    rays = np.stack([(x + 0.5 - WIDTH / 2) / FOCAL, (y + 0.5 - HEIGHT / 2) / FOCAL, np.ones(len(x))], axis=1)
    places = (rays * depth[y, x, None] - first[:3, 3]) @ first[:3, :3]
    u, v, far = projected(places, second)
    inside = (far > 0) & (u > 0) & (u < WIDTH) & (v > 0) & (v < HEIGHT)
    u, v, far = u[inside].astype(int), v[inside].astype(int), far[inside]
    seen = np.abs(other_depth[v, u] - far) < 0.03 * far
    colours = picture[y, x][inside].astype(float), other[v, u].astype(float)
    # Pixels of a blotched wall are not at the same point of it: most differ by a few of 255, chance by about 40.
    assert seen.sum() > 300 and np.median(np.abs(colours[0] - colours[1])[seen]) < 10


def projected(places: Float64, viewmat: Float64) -> tuple[Float64, Float64, Float64]:
    x, y, far = (places @ viewmat[:3, :3].T + viewmat[:3, 3]).T
    return x / far * FOCAL + WIDTH / 2, y / far * FOCAL + HEIGHT / 2, far
