"""Random scenes, drawn by hypothesis, stay within the same bounds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.quality.stability.bounds import DEFAULT, Bounds
from engine.quality.stability.measure import measure_scene
from engine.quality.stability.scenes import Scene, ordinary_scene, slanted_camera

# In a small picture, one pixel near a threshold is a large share of all.
SMALL = replace(DEFAULT, near_share=1.0)
QUICK = settings(max_examples=40, derandomize=True, deadline=None, database=None)


@st.composite
def scenes(draw: st.DrawFn) -> Scene:
    """Draw a few Gaussians of any size, aspect, opacity, rotation and position, and a small picture of any size."""
    n = draw(st.integers(1, 10))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    camera = slanted_camera(draw(st.integers(1, 37)), draw(st.integers(1, 37)), focal=draw(st.floats(5.0, 200.0)))
    low, high = sorted(draw(st.tuples(st.floats(-7.0, 4.0), st.floats(-7.0, 4.0))))
    spread = 10.0 ** draw(st.floats(-3.0, 2.0))
    length = 10.0 ** draw(st.floats(-6.0, 18.0))
    logit = draw(st.floats(-6.0, 20.0))
    depth = 10.0 ** draw(st.floats(-1.5, 2.0))
    unit = rng.normal(size=(n, 4))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    return ordinary_scene(n, camera=camera).with_arrays(
        means=rng.normal(size=(n, 3)) * [spread, spread, 0.3 * depth] + [0.0, 0.0, depth],
        quats=unit * length,
        scales=10.0 ** rng.uniform(low, high, (n, 3)),
        opacities=1.0 / (1.0 + np.exp(-logit - rng.normal(size=n))),
        sh=rng.normal(size=(n, 16, 3)),
    )


def assert_within(scene: Scene, bounds: Bounds) -> None:
    finding = measure_scene(scene, bounds)
    assert finding.problems == (), finding


@QUICK
@given(scenes())
def test_a_random_scene_stays_within_the_bounds(scene: Scene) -> None:
    assert_within(scene, SMALL)


@QUICK
@given(scenes(), st.integers(0, 9), st.sampled_from([0.0, -1.0, 1e-9]))
def test_a_gaussian_behind_the_near_plane_changes_nothing(scene: Scene, at: int, z: float) -> None:
    """At any place in the arrays, it is culled and the picture of the others stays exactly the same."""
    n = len(scene.means)
    at = min(at, n)
    viewmat = scene.camera.viewmat
    position = viewmat[:3, :3].T @ (np.array([0.1, 0.1, z]) - viewmat[:3, 3])
    index = np.insert(np.arange(n), at, 0)
    means = np.asarray(scene.means)[index]
    means[at] = position
    larger = scene.rows(index).with_arrays(means=means)
    raster, larger_raster = (s.cast(torch.float32).render("cpu") for s in (scene, larger))
    assert bool((raster.image == larger_raster.image).all())
    assert larger_raster.culled.near == raster.culled.near + 1


@QUICK
@given(scenes(), st.integers(0, 2**32 - 1))
def test_length_and_sign_of_quaternions_do_not_change_the_picture(scene: Scene, seed: int) -> None:
    rng = np.random.default_rng(seed)
    # Short ones grow and long ones shrink: still shorter ones are culled, and the square of longer ones overflows.
    direction = np.where(np.linalg.norm(np.asarray(scene.quats), axis=1, keepdims=True) < 1.0, 1.0, -1.0)
    factors = 2.0 ** (direction * rng.integers(0, 20, (len(scene.means), 1))) * rng.choice(
        [-1.0, 1.0], (len(scene.means), 1)
    )
    scaled = scene.with_arrays(quats=np.asarray(scene.quats) * factors)
    one, two = (s.cast(torch.float32).render("cpu") for s in (scene, scaled))
    assert bool((one.visible == two.visible).all())
    assert float((one.image - two.image).detach().abs().max()) <= 1e-6 * max(1.0, float(one.image.detach().abs().max()))
