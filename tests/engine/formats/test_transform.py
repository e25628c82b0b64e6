"""Transformed Gaussians obey the laws of rotations and have the ellipsoids and colours of the definition."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from engine.core.errors import NumericalError
from engine.formats.spherical_harmonics import orthogonal_sh_matrix, sh_basis
from engine.formats.transform import (
    AffineMap,
    logits_of,
    quats_from_rotations,
    transform_gaussians,
)
from engine.scene import rotations_from_quats, unit_quats
from engine.scene.gaussians import Gaussians

from .conftest import RandomGaussians


def rotation(seed: int) -> np.ndarray:
    return rotations_from_quats(np.random.default_rng(seed).standard_normal((1, 4)))[0]


def affine(linear: np.ndarray, translation: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = linear
    matrix[:3, 3] = translation
    return matrix


def covariances(gaussians: Gaussians) -> np.ndarray:
    axes = rotations_from_quats(gaussians.quats) * np.exp(gaussians.log_scales.astype(np.float64))[:, None, :]
    return axes @ axes.transpose(0, 2, 1)


def directions(count: int, seed: int = 1) -> np.ndarray:
    vectors = np.random.default_rng(seed).standard_normal((count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def test_basis_is_orthonormal_over_the_sphere() -> None:
    # Gauss-Legendre in z times equal angles integrates degree 6 exactly; largest rounding error seen 4e-16.
    z, weights = np.polynomial.legendre.leggauss(8)
    angle = np.arange(16) * np.pi / 8
    zz, aa = np.meshgrid(z, angle, indexing="ij")
    points = np.stack([np.sqrt(1 - zz**2) * np.cos(aa), np.sqrt(1 - zz**2) * np.sin(aa), zz], axis=-1).reshape(-1, 3)
    weight = np.repeat(weights, 16) * np.pi / 8
    basis = sh_basis(points, 3)
    np.testing.assert_allclose(basis.T @ (basis * weight[:, None]), np.eye(16), atol=1e-14)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("mirror", [1, -1])
def test_a_rotated_colour_is_seen_from_rotated_directions(seed: int, mirror: int) -> None:
    turn = rotation(seed) * mirror
    coefficients = np.random.default_rng(seed).standard_normal((16, 3))
    d = directions(100, seed)
    turned = orthogonal_sh_matrix(turn, 3) @ coefficients
    # Float64 throughout; worst seen 4e-15.
    np.testing.assert_allclose(sh_basis(d @ turn.T, 3) @ turned, sh_basis(d, 3) @ coefficients, atol=1e-13)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_similarity_moves_centres_ellipsoids_and_colours(degree: int, random_gaussians: RandomGaussians) -> None:
    gaussians = random_gaussians(50, degree=degree)
    turn, size = rotation(3), 2.5
    moved = transform_gaussians(gaussians, affine(size * turn, (1.0, -2.0, 3.0)))
    np.testing.assert_allclose(moved.means, gaussians.means @ (size * turn).T + (1, -2, 3), atol=2e-6)
    expected = size**2 * turn @ covariances(gaussians) @ turn.T
    # float32 quaternions and log-scales: 6e-8 relative each, worst seen 1e-6 of the largest entry.
    np.testing.assert_allclose(covariances(moved), expected, rtol=0, atol=5e-6 * np.abs(expected).max())
    d = directions(20)
    before = np.einsum("dk,nkc->ndc", sh_basis(d, degree), gaussians.sh)
    after = np.einsum("dk,nkc->ndc", sh_basis(d @ turn.T, degree), moved.sh)
    np.testing.assert_allclose(after, before, atol=2e-6)


@pytest.mark.parametrize("linear", [2.5 * rotation(3), np.diag([3.0, 0.2, 1.0])])
def test_gaussians_are_turned_in_place_as_in_a_copy(linear: np.ndarray, random_gaussians: RandomGaussians) -> None:
    gaussians = random_gaussians(1500)  # more than are turned at once
    expected = transform_gaussians(gaussians, affine(linear, (1.0, -2.0, 3.0)))
    AffineMap.of(affine(linear, (1.0, -2.0, 3.0)), 3).apply(gaussians, into=gaussians)
    for name in ("means", "log_scales", "quats", "sh"):
        np.testing.assert_array_equal(getattr(gaussians, name), getattr(expected, name))


@pytest.mark.parametrize(
    "linear",
    [np.diag([3.0, 0.2, 1.0]), np.diag([1.0, 1.0, -1.0]), rotation(5) @ np.diag([1, 2, 3]) @ rotation(6)],
)
def test_stretched_and_mirrored_ellipsoids_are_exact(linear: np.ndarray, random_gaussians: RandomGaussians) -> None:
    gaussians = random_gaussians(50, degree=1)
    moved = transform_gaussians(gaussians, affine(linear))
    expected = linear @ covariances(gaussians) @ linear.T
    np.testing.assert_allclose(covariances(moved), expected, rtol=0, atol=5e-6 * np.abs(expected).max())


def test_mirrored_colour_is_seen_in_the_mirror(random_gaussians: RandomGaussians) -> None:
    gaussians, mirror, d = random_gaussians(5), np.diag([1.0, 1.0, -1.0]), directions(20)
    moved = transform_gaussians(gaussians, affine(mirror))
    before = np.einsum("dk,nkc->ndc", sh_basis(d, 3), gaussians.sh)
    np.testing.assert_allclose(np.einsum("dk,nkc->ndc", sh_basis(d @ mirror, 3), moved.sh), before, atol=2e-6)


def test_needles_stay_needles_when_stretched(random_gaussians: RandomGaussians) -> None:
    gaussians = random_gaussians(20, degree=0)
    gaussians.log_scales[:] = np.log([1e-5, 1.0, 1e-5])
    moved = transform_gaussians(gaussians, affine(rotation(1) @ np.diag([1.0, 1.5, 0.5])))
    sizes = np.sort(moved.scales, axis=1)
    # Aspect ratio 1e5: the SVD of R S keeps the small axes, a float32 covariance would lose them.
    assert (sizes[:, :2] < 2e-5).all() and (sizes[:, :2] > 4e-6).all()


def test_identity_changes_nothing_and_the_input_is_not_modified(
    random_gaussians: RandomGaussians, assert_same_gaussians: Callable[..., None]
) -> None:
    gaussians, untouched = random_gaussians(20), random_gaussians(20)
    assert_same_gaussians(transform_gaussians(gaussians, np.eye(4)), untouched)
    transform_gaussians(gaussians, affine(2 * rotation(0)))
    assert_same_gaussians(gaussians, untouched)


def test_two_transforms_equal_their_product(random_gaussians: RandomGaussians) -> None:
    gaussians = random_gaussians(30)
    first, second = affine(2 * rotation(1), (1, 2, 3)), affine(0.5 * rotation(2), (-1, 0, 1))
    once = transform_gaussians(gaussians, second @ first)
    twice = transform_gaussians(transform_gaussians(gaussians, first), second)
    for name in ("means", "log_scales", "quats", "sh"):
        got, wanted = getattr(twice, name), getattr(once, name)
        if name == "quats":  # q and -q are one rotation
            got = got * np.sign((got * wanted).sum(axis=1, keepdims=True))
        np.testing.assert_allclose(got, wanted, atol=5e-6, err_msg=name)


def test_georeferenced_origin_keeps_its_float32_precision(random_gaussians: RandomGaussians) -> None:
    gaussians = random_gaussians(10, degree=0)
    moved = transform_gaussians(gaussians, affine(np.eye(3), (5e5, 4.5e6, 100.0)))
    # Rounded once, at the end: half a unit in the last place at 4.5e6 is 0.25.
    exact = gaussians.means.astype(np.float64) + (5e5, 4.5e6, 100.0)
    assert np.abs(moved.means - exact).max() <= 0.25


@pytest.mark.parametrize("matrix", [np.diag([1.0, 1.0, 0.0, 1.0]), np.full((4, 4), np.nan)])
def test_a_singular_map_is_refused(matrix: np.ndarray, random_gaussians: RandomGaussians) -> None:
    with pytest.raises(NumericalError, match="transform `matrix`"):
        transform_gaussians(random_gaussians(3), matrix)


def test_quaternions_and_matrices_agree_at_half_turns() -> None:
    quats = np.array(
        [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [1e-9, 1, 1, 0], [0.5, 0.5, 0.5, 0.5]], float
    )
    unit = quats / np.linalg.norm(quats, axis=1, keepdims=True)
    again = quats_from_rotations(rotations_from_quats(quats))
    np.testing.assert_allclose(np.abs((again * unit).sum(axis=1)), 1, atol=1e-15)


def test_logits_of_opacities_0_and_1_are_finite_and_exact_in_float32() -> None:
    opacities = np.array([0, 1e-38, 0.25, 0.5, 1 - 2.0**-24, 1], np.float32)
    logits = logits_of(opacities)
    assert np.isfinite(logits).all()
    back = (1 / (1 + np.exp(-logits.astype(np.float64)))).astype(np.float32)
    np.testing.assert_allclose(back, opacities, rtol=4e-6, atol=6e-8)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_quaternion_without_a_direction_is_no_rotation(dtype: type) -> None:
    unit = unit_quats(np.array([[0, 0, 0, 0], [0, 3, 0, 4]], dtype))
    assert unit.dtype == dtype and np.allclose(unit, [[1, 0, 0, 0], [0, 0.6, 0, 0.8]])
