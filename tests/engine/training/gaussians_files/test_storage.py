"""A trained scene is read as it was written, and files that do not belong together are refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from engine.core.errors import FormatError, NumericalError
from engine.scene.gaussians import Gaussians
from engine.training.scene_files import load_gaussians, save_gaussians


def make(n: int, features: bool = True) -> Gaussians:
    rng = np.random.default_rng(n)
    shapes = {"means": (n, 3), "log_scales": (n, 3), "quats": (n, 4), "opacity_logits": (n,), "sh": (n, 4, 3)}
    arrays = {name: rng.normal(size=shape).astype(np.float32) for name, shape in shapes.items()}
    return Gaussians(**arrays, features=rng.normal(size=(n, 16)).astype(np.float32) if features else None)


@pytest.mark.parametrize("n", [1, 100])
def test_scene_and_features_are_read_as_written(tmp_path: Path, n: int) -> None:
    scene = make(n)
    save_gaussians(tmp_path, scene)
    loaded = load_gaussians(tmp_path)
    for name in ("means", "log_scales", "quats", "opacity_logits", "sh"):
        assert np.array_equal(getattr(loaded, name), getattr(scene, name)), name
    # float16 keeps 11 bits.
    assert np.allclose(loaded.features, scene.features, rtol=2**-11, atol=1e-7)
    assert loaded.features.dtype == np.float32


def test_scene_without_features_removes_those_of_an_earlier_run(tmp_path: Path) -> None:
    save_gaussians(tmp_path, make(20))
    save_gaussians(tmp_path, make(20, features=False))
    assert load_gaussians(tmp_path).features is None
    assert sorted(file.name for file in tmp_path.iterdir()) == ["scene.ply"]


def test_features_of_another_scene_are_refused(tmp_path: Path) -> None:
    save_gaussians(tmp_path, make(20))
    np.save(tmp_path / "features.npy", np.zeros((19, 16), np.float16))
    with pytest.raises(FormatError, match="do not belong together"):
        load_gaussians(tmp_path)


def test_errors_name_damaged_features_and_a_missing_scene(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="Run `reconstruct` first"):
        load_gaussians(tmp_path)
    save_gaussians(tmp_path, make(20))
    (tmp_path / "features.npy").write_bytes(b"not an array")
    with pytest.raises(FormatError, match=r"features\.npy"):
        load_gaussians(tmp_path)


def test_features_cut_in_half_are_refused(tmp_path: Path) -> None:
    save_gaussians(tmp_path, make(20))
    whole = (tmp_path / "features.npy").read_bytes()
    (tmp_path / "features.npy").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FormatError, match=r"features\.npy cannot be read: .* Run `reconstruct` again"):
        load_gaussians(tmp_path)


def test_new_scene_is_seen_before_it_replaces_the_old_one(tmp_path: Path) -> None:
    save_gaussians(tmp_path, make(20))
    before = (tmp_path / "scene.ply").read_bytes()
    seen = []

    def look(new: Path) -> None:
        assert (tmp_path / "scene.ply").read_bytes() == before
        seen.append(new.read_bytes())

    save_gaussians(tmp_path, make(30), before_replacing=look)
    assert seen == [(tmp_path / "scene.ply").read_bytes()] != [before]


def test_values_that_are_not_finite_are_not_written(tmp_path: Path) -> None:
    scene = make(5)
    with pytest.raises(NumericalError):
        save_gaussians(tmp_path, replace(scene, features=np.full((5, 16), 1e6, np.float32)))
    assert list(tmp_path.iterdir()) == []
