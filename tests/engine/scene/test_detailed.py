"""Detailed Gaussians of an object are read as written, and a damaged file is one sentence."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from engine.core.errors import FormatError
from engine.scene import Detailed, Gaussians, load_detailed, save_detailed


def detailed(count: int = 4) -> Detailed:
    rng = np.random.default_rng(0)

    def values(*shape: int) -> np.ndarray:
        return rng.normal(size=(count, *shape)).astype(np.float32)

    gaussians = Gaussians(values(3), values(3), values(4), values(), values(4, 3))
    rows = np.arange(count, dtype=np.int32) * 3
    return Detailed(rows, values(3), rows, gaussians)


def folder_of(project: Path) -> Path:
    return project / "objects" / "vase"


def rewrite(project: Path, **changes: np.ndarray) -> None:
    file = folder_of(project) / "detail.npz"
    with np.load(file) as archive:
        arrays = dict(archive)
    np.savez(file, **{**arrays, **changes})


@pytest.mark.parametrize("count", [0, 1, 4])
def test_detailed_gaussians_are_read_as_written(tmp_path: Path, count: int) -> None:
    written = detailed(count)
    save_detailed(folder_of(tmp_path), written)
    read = load_detailed(tmp_path, "vase")
    assert read is not None
    for name in ("means", "log_scales", "quats", "opacity_logits", "sh"):
        np.testing.assert_array_equal(getattr(read.gaussians, name), getattr(written.gaussians, name))
    np.testing.assert_array_equal(read.rows, written.rows)
    np.testing.assert_array_equal(read.parents, written.parents)


def test_a_gaussian_without_detailed_ones_is_not_shown(tmp_path: Path) -> None:
    written = detailed()
    save_detailed(folder_of(tmp_path), written)
    rewrite(tmp_path, parents=np.array([0, 3, 6, 6], np.int32))
    read = load_detailed(tmp_path, "vase")
    assert read is not None
    scene = replace(written.gaussians, means=written.trained_means)
    joined, source = read.with_detail(scene, written.rows)
    np.testing.assert_array_equal(source, [0, 1, 2, 2])
    np.testing.assert_array_equal(joined.means, written.gaussians.means)
    moved = replace(scene, means=scene.means + 1)  # the user moved all of them
    np.testing.assert_array_equal(read.with_detail(moved, written.rows)[0].means, moved.means)


def test_an_object_of_which_no_gaussian_has_detailed_ones_stays_as_in_the_scene() -> None:
    written = detailed()
    part = replace(written, parents=written.parents[:2], gaussians=written.gaussians[np.arange(2)])
    scene = replace(written.gaussians, means=written.trained_means)
    joined, source = part.with_detail(scene[np.arange(2, 4)], written.rows[2:])
    np.testing.assert_array_equal(source, [0, 1])
    np.testing.assert_array_equal(joined.means, scene.means[2:])


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"rows": np.array([3, 2, 1, 0], np.int32)}, "not ascending"),
        ({"rows": np.array([0, 1, 1, 2], np.int32)}, "not ascending"),
        ({"rows": np.array([-5, 1, 2, 3], np.int32)}, "not ascending"),
        ({"rows": np.arange(3, dtype=np.int32)}, "shape"),
        ({"rows": np.arange(4.0)}, "type float64"),
        ({"parents": np.array([0, 3, 6, 7], np.int32)}, "`parents` are not of its `rows`"),
        ({"parents": np.array([3, 0, 6, 9], np.int32)}, "`parents` are not of its `rows`"),
        ({"parents": np.array([0, 3, 6, 90], np.int32)}, "`parents` are not of its `rows`"),
        ({"means": np.full((4, 3), np.nan, np.float32)}, "not finite"),
        ({"quats": np.zeros((4, 3), np.float32)}, "shape"),
        ({"sh": np.zeros((4, 5, 3), np.float32)}, "`sh` has an unexpected shape"),
        ({"sh": np.zeros(4, np.float32)}, "shape"),
    ],
)
def test_values_that_contradict_each_other_are_one_sentence(
    tmp_path: Path, changes: dict[str, np.ndarray], problem: str
) -> None:
    save_detailed(folder_of(tmp_path), detailed())
    rewrite(tmp_path, **changes)
    with pytest.raises(FormatError) as caught:
        load_detailed(tmp_path, "vase")
    assert problem in str(caught.value) and str(caught.value).endswith("Isolate the object again.")


@pytest.mark.parametrize("part", [0.0, 0.3, 0.7, 0.99])
def test_half_a_file_is_one_sentence(tmp_path: Path, part: float) -> None:
    save_detailed(folder_of(tmp_path), detailed())
    file = folder_of(tmp_path) / "detail.npz"
    file.write_bytes(file.read_bytes()[: int(part * file.stat().st_size)])
    with pytest.raises(FormatError, match=r"detail\.npz cannot be read: .* Isolate the object again\."):
        load_detailed(tmp_path, "vase")
