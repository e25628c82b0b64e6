"""Sub-models of one COLMAP project, joined where they have photos in common.

COLMAP numbers sub-models in the order in which it began them. Each has a world of its own, and two of them are related
by a similarity (rotation, scale, translation), which the cameras of common photos determine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..core.arrays import Float64
from .model_reading import SparsePoints
from .orientation import GivenCamera

_MIN_COMMON = 2
"""Common photos that two parts need: a single one does not determine their scale."""
_MAX_ANGLE, _MAX_SHIFT = np.radians(2.0), 0.03
"""Largest median disagreement of common cameras after joining: in their rotation, and in their position relative to the
distance between them. Models of the same photos by COLMAP agree to 0.1 degrees and 0.2 %."""
_MAX_NAMES = 3


@dataclass(frozen=True)
class Part:
    """A sub-model: its name for messages, its cameras of photos, and its points."""

    label: str
    cameras: list[GivenCamera]
    points: SparsePoints


def joined_parts(parts: Sequence[Part], model: Path) -> tuple[Part, str | None]:
    """Return the part with the most photos, with all others that can be joined to it, and what happened as a sentence.

    Parameters
    ----------
    parts : sequence of Part
        At least one, each with a camera.
    model : Path
        For the sentence, which is None for a single part.
    """
    ordered = sorted(parts, key=lambda part: (-len(part.cameras), -len(part.points.positions)))
    whole, waiting, joined = ordered[0], list(ordered[1:]), [ordered[0]]
    progress = True
    while progress:
        progress = False
        for part in list(waiting):
            similarity = _similarity(whole, part)
            if similarity is not None:
                whole = _with(whole, part, similarity)
                waiting.remove(part)
                joined.append(part)
                progress = True
    return whole, _sentence(joined, waiting, whole, model)


def _sentence(joined: Sequence[Part], left: Sequence[Part], whole: Part, model: Path) -> str | None:
    if len(joined) + len(left) == 1:
        return None
    known = {camera.photo.name for camera in whole.cameras}
    text = f"The model in {model} has {len(joined) + len(left)} parts: "
    if len(joined) == 1:
        text += f"the largest, {joined[0].label} with {len(known)} photos, is used"
    else:
        text += f"{' and '.join(part.label for part in joined)} were joined, {len(known)} photos in all"
    if not left:
        return text + "."
    others = []
    for part in left:
        lost = sorted({camera.photo.name for camera in part.cameras} - known)
        shown = ", ".join(lost[:_MAX_NAMES]) + (" and others" if len(lost) > _MAX_NAMES else "")
        others.append(f"{part.label} with {len(lost)} more photos" + (f" ({shown})" if lost else ""))
    return f"{text}; not used, because nothing connects them: {'; '.join(others)}."


def _similarity(whole: Part, part: Part) -> Float64 | None:
    """Return the similarity [4, 4] from the world of `part` to that of `whole`; None where they are not connected."""
    known = {camera.photo.name: camera.viewmat for camera in whole.cameras}
    pairs = [(known[one.photo.name], one.viewmat) for one in part.cameras if one.photo.name in known]
    if len(pairs) < _MIN_COMMON:
        return None
    to = np.stack([viewmat for viewmat, _ in pairs])
    start = np.stack([viewmat for _, viewmat in pairs])
    # The mean of R_to^T R_start over the common cameras, as the nearest rotation.
    left, _, right = np.linalg.svd(np.einsum("cji,cjk->ik", to[:, :3, :3], start[:, :3, :3]))
    rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    centers_to, centers = _centers(to), _centers(start)
    across_to, across = centers_to - np.median(centers_to, axis=0), centers - np.median(centers, axis=0)
    spread, spread_to = np.linalg.norm(across, axis=1).sum(), np.linalg.norm(across_to, axis=1).sum()
    if not (spread > 0.0 and spread_to > 0.0):
        return None
    similarity = np.eye(4)
    similarity[:3, :3] = spread_to / spread * rotation
    similarity[:3, 3] = np.median(centers_to - centers @ similarity[:3, :3].T, axis=0)
    turned = np.einsum("cij,cjk->cik", to[:, :3, :3], rotation[None] @ start[:, :3, :3].transpose(0, 2, 1))
    angles = np.arccos(np.clip((np.trace(turned, axis1=1, axis2=2) - 1.0) / 2.0, -1.0, 1.0))
    moved = centers @ similarity[:3, :3].T + similarity[:3, 3]
    shifts = np.linalg.norm(moved - centers_to, axis=1) / (spread_to / len(pairs))
    return similarity if np.median(angles) <= _MAX_ANGLE and np.median(shifts) <= _MAX_SHIFT else None


def _centers(viewmats: Float64) -> Float64:
    centers: Float64 = -np.einsum("cji,cj->ci", viewmats[:, :3, :3], viewmats[:, :3, 3])
    return centers


def _with(whole: Part, part: Part, similarity: Float64) -> Part:
    """Return `whole` with those cameras of `part` that it lacks, and with its points."""
    scale = np.cbrt(np.linalg.det(similarity[:3, :3]))
    known = {camera.photo.name for camera in whole.cameras}
    n_points = len(whole.points.positions)
    cameras = list(whole.cameras)
    for camera in part.cameras:
        if camera.photo.name not in known:
            moved = np.eye(4)
            moved[:3, :3] = camera.viewmat[:3, :3] @ similarity[:3, :3].T / scale
            moved[:3, 3] = scale * camera.viewmat[:3, 3] - moved[:3, :3] @ similarity[:3, 3]
            cameras.append(replace(camera, viewmat=moved, seen=camera.seen + n_points))
    positions = part.points.positions @ similarity[:3, :3].T + similarity[:3, 3]
    points = SparsePoints(
        np.concatenate([whole.points.positions, positions]),
        np.concatenate([whole.points.colors, part.points.colors]),
        whole.points.reprojection_error,
    )
    return Part(whole.label, cameras, points)
