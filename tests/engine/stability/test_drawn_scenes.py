"""Scenes nobody thought of, drawn by hypothesis, stay within the same bounds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.stability.bounds import DEFAULT, Bounds
from engine.stability.measure import measure_scene
from engine.stability.scenes import Scene, ordinary_scene, slanted_camera

# A picture may be small: then one pixel at a threshold is a large part of it, and no reason to doubt the rest.
SMALL = replace(DEFAULT, near_share=1.0)
QUICK = settings(max_examples=80, derandomize=True, deadline=None, database=None)


@st.composite
def scenes(draw: st.DrawFn) -> Scene:
    """A few Gaussians of any size, aspect, opacity, rotation and place, seen in a picture of any small size."""
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


def within(scene: Scene, bounds: Bounds) -> None:
    finding = measure_scene(scene, bounds)
    assert finding.problems == (), finding


@QUICK
@given(scenes())
def test_a_drawn_scene_stays_within_the_bounds(scene: Scene) -> None:
    within(scene, SMALL)


@QUICK
@given(scenes(), st.integers(0, 9), st.sampled_from([0.0, -1.0, 1e-9]))
def test_a_gaussian_behind_the_near_plane_changes_nothing(scene: Scene, at: int, z: float) -> None:
    """Put among the others, wherever in the arrays, it is culled and leaves their picture as it was, to the bit."""
    n = len(scene.means)
    at = min(at, n)
    viewmat = scene.camera.viewmat
    place = viewmat[:3, :3].T @ (np.array([0.1, 0.1, z]) - viewmat[:3, 3])
    index = np.insert(np.arange(n), at, 0)
    means = np.asarray(scene.means)[index]
    means[at] = place
    more = scene.rows(index).with_arrays(means=means)
    picture, fuller = (s.cast(torch.float32).render("cpu") for s in (scene, more))
    assert bool((picture.image == fuller.image).all())
    assert fuller.culled.near == picture.culled.near + 1


@QUICK
@given(scenes(), st.integers(0, 2**32 - 1))
def test_a_quaternion_s_length_and_sign_change_nothing_that_can_be_seen(scene: Scene, seed: int) -> None:
    rng = np.random.default_rng(seed)
    factors = 2.0 ** rng.integers(-10, 10, (len(scene.means), 1)) * rng.choice([-1.0, 1.0], (len(scene.means), 1))
    other = scene.with_arrays(quats=np.asarray(scene.quats) * factors)
    one, two = (s.cast(torch.float32).render("cpu") for s in (scene, other))
    assert bool((one.visible == two.visible).all())
    assert float((one.image - two.image).detach().abs().max()) <= 1e-6 * max(1.0, float(one.image.detach().abs().max()))
