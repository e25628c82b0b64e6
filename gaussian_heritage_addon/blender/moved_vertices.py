"""Splats follow operators of Blender that move vertices only: Apply, Join, and transforms in Edit Mode.

Blender moves the vertices of a mesh, but not the attributes that describe the size, rotation and colours of a splat.
Each vertex keeps the position for which its attributes are right, and the number of the object it was made for. From
the two positions follows the map by which the vertices of one object were moved together.
"""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float32, Float64
from .attributes import read_attribute, write_attribute

LinearMaps = list[tuple[Float64, NDArray[np.intp]]]
"""Linear maps [3, 3], and the rows of the vertices that each moved. Where vertices were only shifted there is none."""

_RIGHT_AT, _MADE_AS = "heritage_right_at", "heritage_made_as"
_ROUNDING = 64 * float(np.finfo(np.float32).eps)
"""Error of a position after Blender's transforms in float32, relative to its size."""
_MIN_TOGETHER = 8
"""Fewest vertices whose own map is believed: four fit any map."""
_SHIFT = 1e-5
"""Largest difference from the identity of the linear part of a map that only shifts."""
_SAMPLES = 200
"""Maps through four vertices that are tried to find vertices that moved together."""
_WINDOW = 64
"""Vertices among which the four are chosen: Join keeps the order, so those of one object are near each other."""


def mark_as_right(mesh: bpy.types.Mesh, made_as: int | None = None) -> None:
    """Store that the attributes of the splats are right at their present positions.

    Parameters
    ----------
    made_as : int, optional
        Number of the object, above 0, where the vertices are new. Joined vertices keep theirs.
    """
    if not len(mesh.vertices):
        return
    write_attribute(mesh, _RIGHT_AT, "FLOAT_VECTOR", _positions(mesh))
    if made_as is not None:
        write_attribute(mesh, _MADE_AS, "INT", np.full(len(mesh.vertices), made_as))


def moves_since(mesh: bpy.types.Mesh) -> LinearMaps | None:
    """Return how the vertices moved since `mark_as_right`; None where nothing moved, or nothing was marked."""
    marked = _marked(mesh)
    if marked is None:
        return None
    (before, made_as), after = marked, _positions(mesh)
    if np.array_equal(before, after):
        return None
    found: LinearMaps = []
    moved = (before != after).any(axis=1)
    # Vertices without a number came from a mesh without splats.
    for one in np.unique(made_as[moved & (made_as > 0)]):
        rows = np.flatnonzero(made_as == one)
        found += [(linear, rows[part]) for linear, part in linear_maps(before[rows], after[rows])]
    return found


def _marked(mesh: bpy.types.Mesh) -> tuple[Float32, NDArray[np.int32]] | None:
    """Return the positions [N, 3] for which the attributes are right, and the numbers [N]; None without marks."""
    before, made_as = read_attribute(mesh, _RIGHT_AT, "FLOAT_VECTOR"), read_attribute(mesh, _MADE_AS, "INT")
    return None if before is None or made_as is None else (before, made_as)


def main_move(mesh: bpy.types.Mesh, made_as: int) -> Float64:
    """Return the map [4, 4] by which most of the vertices of one number moved since `mark_as_right`.

    It is the identity where they did not move, or moved in no common way.
    """
    marked = _marked(mesh)
    if marked is None:
        return np.eye(4)
    before, numbers = marked
    rows = np.flatnonzero(numbers == made_as)
    return _main_map(before[rows], _positions(mesh)[rows])


def _main_map(earlier: NDArray[np.floating], later: NDArray[np.floating]) -> Float64:
    """Return the map [4, 4] that took most of the positions `earlier` to those `later`, both of shape [N, 3].

    It is the identity where no map explains several of them.
    """
    before: Float64 = np.asarray(earlier, np.float64)
    after: Float64 = np.asarray(later, np.float64)
    finite = np.isfinite(before).all(axis=1) & np.isfinite(after).all(axis=1)
    before, after = before[finite], after[finite]
    matrix = np.eye(4)
    if not len(before) or np.array_equal(before, after):
        return matrix
    inside, fitted = _moved_together(before, after, np.random.default_rng(0))
    if fitted is not None and len(inside) >= min(_MIN_TOGETHER, len(before)):
        matrix[:3] = fitted
    if np.abs(matrix[:3, :3] - np.eye(3)).max() <= _SHIFT:
        matrix[:3, :3] = np.eye(3)
    return matrix


def _positions(mesh: bpy.types.Mesh) -> Float32:
    positions = read_attribute(mesh, "position", "FLOAT_VECTOR")
    return np.zeros((0, 3), np.float32) if positions is None else positions


def linear_maps(earlier: NDArray[np.floating], later: NDArray[np.floating]) -> LinearMaps:
    """Return the linear parts of the maps that took the positions `earlier` to those `later`, both of shape [N, 3].

    Positions that no map explains, such as those of single vertices that were moved by hand, follow the map that comes
    nearest. Positions that moved in no common way, as with a brush, follow none.
    """
    before: Float64 = np.asarray(earlier, np.float64)
    after: Float64 = np.asarray(later, np.float64)
    finite = np.isfinite(before).all(axis=1) & np.isfinite(after).all(axis=1)
    left, maps = np.flatnonzero(finite), []
    groups: list[NDArray[np.intp]] = []
    random = np.random.default_rng(0)
    while len(left):
        inside, fitted = _moved_together(before[left], after[left], random)
        if fitted is None or (len(inside) < min(_MIN_TOGETHER, len(before))):
            break
        maps.append(fitted)
        groups.append(left[inside])
        left = np.setdiff1d(left, left[inside], assume_unique=True)
    if not maps:
        return []
    if len(left):
        distances = np.stack([np.linalg.norm(_placed(one, before[left]) - after[left], axis=1) for one in maps])
        nearest = distances.argmin(axis=0)
        groups = [np.concatenate([group, left[nearest == k]]) for k, group in enumerate(groups)]
    return [(one[:, :3], np.sort(group)) for one, group in zip(maps, groups, strict=True) if not _is_shift(one)]


def _moved_together(
    before: Float64, after: Float64, random: np.random.Generator
) -> tuple[NDArray[np.intp], Float64 | None]:
    """Return the rows of the most positions that one map explains, and the map [3, 4]."""
    shift = np.concatenate([np.eye(3), np.median(after - before, axis=0)[:, None]], axis=1)
    candidates = [shift]
    whole = _fitted(before, after)
    if whole is not None:
        candidates.append(whole)
    best = _best(candidates, before, after)
    if len(best[0]) < len(before):
        candidates = []
        for _ in range(_SAMPLES):
            start = int(random.integers(max(1, len(before) - _WINDOW + 1)))
            near = np.arange(start, min(len(before), start + _WINDOW))
            chosen = random.choice(near, min(4, len(near)), replace=False)
            sample = _fitted(before[chosen], after[chosen])
            if sample is not None:
                candidates.append(sample)
        # Fitted again to all that it explains, as four positions give an inexact map.
        rough = _best(candidates, before, after, tolerance=100.0)
        if rough[1] is not None:
            again = _fitted(before[rough[0]], after[rough[0]])
            best = max(best, _best([again] if again is not None else [], before, after), key=lambda one: len(one[0]))
    return best


def _best(
    candidates: list[Float64], before: Float64, after: Float64, tolerance: float = 1.0
) -> tuple[NDArray[np.intp], Float64 | None]:
    rows: NDArray[np.intp] = np.zeros(0, np.intp)
    found = None
    size = np.abs(before).max(initial=0)
    for one in candidates:
        terms = np.abs(one[:, :3]).sum(axis=1).max() * size + np.abs(one[:, 3]).max() + np.abs(after).max(axis=1)
        inside = np.flatnonzero(np.abs(_placed(one, before) - after).max(axis=1) <= tolerance * _ROUNDING * terms)
        if len(inside) > len(rows):
            rows, found = inside, one
    return rows, found


def _fitted(before: Float64, after: Float64) -> Float64 | None:
    """Return the affine map [3, 4] that takes `before` nearest to `after`; a similarity where they lie in a plane."""
    middle, target = before.mean(axis=0), after.mean(axis=0)
    x, y = before - middle, after - target
    size = np.linalg.norm(x)
    if len(before) < 2 or size == 0:
        return None
    if len(before) > 3 and np.linalg.svd(x, compute_uv=False)[2] > 1e-4 * size:
        linear = np.linalg.lstsq(x, y, rcond=None)[0].T
    else:
        left, _, right = np.linalg.svd(y.T @ x)
        flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right)) or 1.0])
        linear = np.linalg.norm(y) / size * (left @ flip @ right)
    if not np.linalg.svd(linear, compute_uv=False)[2] > 1e-6 * np.linalg.norm(linear):
        return None
    return np.concatenate([linear, (target - linear @ middle)[:, None]], axis=1)


def _placed(affine: Float64, points: Float64) -> Float64:
    return points @ affine[:, :3].T + affine[:, 3]


def _is_shift(affine: Float64) -> bool:
    return bool(np.abs(affine[:, :3] - np.eye(3)).max() <= _SHIFT)
