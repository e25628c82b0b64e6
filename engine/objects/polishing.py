"""An object alone: its own Gaussians are trained a little further, so that it is solid and ends at its edge.

In the scene a front may be translucent, since what is behind it has its colour, and a Gaussian may reach into the wall,
since the wall hides it there. Alone, the one is a hole and the other a rag.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from ..errors import Cancelled
from ..events import Emit, Progress, StopCheck
from ..pictures import Scene
from ..scene import Gaussians, PinholeCamera, Polished
from ..training import Parameters, render
from ..training.settings import TrainingSettings
from .settings import SegmentSettings
from .views import View, Views, eroded, spread_cameras

__all__ = ["polish", "polish_each"]

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

_FAINT, _SOLID = 0.2, 0.7
"""Share of a pixel, in the scene, from which on it shows something of the object alone, and nothing but it."""

_IN_FRONT = 0.25
"""Of the object's radius: what is this much nearer than the object alone would be hides it. What is hardly nearer is
the wall or the plinth that a Gaussian of the object reaches into."""

_RIM = 2
"""Pixels, within which an edge may be soft; farther in, what is more of a pixel than all else is solid."""

_FEWEST_PIXELS = 30
_MARGIN = 8
_COVERAGE_WEIGHT = 0.5
_LEARNING_RATES = {
    "means": 0.03,  # in units of the object's median scale
    "log_scales": 0.02,
    "quats": 0.0006,
    "opacity_logits": 0.1,
    "sh_dc": 0.005,
    "sh_rest": 0.0005,
}
_LAST_RATE = 0.1
"""Of the first; the rates fall by the same factor with every step."""

_BLACK = -0.5 / 0.28209479177387814
"""Lowest band of a black Gaussian: colour = 0.5 + 0.282 sh."""


@dataclass(frozen=True)
class _Target:
    """What the object alone should look like in a part of one view.

    Attributes
    ----------
    camera : PinholeCamera
        Of the part, [h, w].
    image : tensor of shape [h, w, 3]
        Over black.
    alpha, known : tensors of shape [h, w]
        How much is covered; and 1 where the view tells, 0 where something hides the object.
    """

    camera: PinholeCamera
    image: torch.Tensor
    alpha: torch.Tensor
    known: torch.Tensor


def polish_each(
    views: Views, objects: Sequence[Mask], settings: SegmentSettings, *, emit: Emit, should_stop: StopCheck
) -> list[Polished | None]:
    """Return what `polish` makes of each of `objects`, masks of shape [N], saying how far it is."""
    done = []
    for number, members in enumerate(objects, start=1):
        done.append(polish(views, members, settings, should_stop=should_stop))
        emit(Progress("objects", number / len(objects), message="Polishing"))
    return done


def polish(views: Views, members: Mask, settings: SegmentSettings, *, should_stop: StopCheck) -> Polished | None:
    """Train the members further until, alone, they look like what is seen of them in the scene, solid and no larger.

    Parameters
    ----------
    views : Views
    members : bool array of shape [N]
        The object.
    settings : SegmentSettings
        `polish_steps`, `n_vote_views`.
    should_stop : callable

    Returns
    -------
    Polished or None
        None for no steps, and for an object that no view sees.

    Raises
    ------
    Cancelled
        When `should_stop` says so.

    Notes
    -----
    The loss of a step is the L1 distance of one view's colours over black, plus one half of that of its coverage, to
    the members' own blended colours in the whole scene, divided by the share s of each pixel that they make up and
    multiplied by the coverage ((s - 0.2) / 0.5, within 0 and 1). So no photo is needed, and no colour of the background
    comes in. Pixels do not count where the scene is clearly in front of the object. Figures: docs/polished_objects.md.
    """
    rows = np.flatnonzero(members)
    if settings.polish_steps == 0 or len(rows) == 0:
        return None
    trained = replace(views.scene.gaussians[rows], features=None)
    targets = _targets(views, members, trained, settings, should_stop)
    if not targets:
        return None
    parameters = Parameters.from_gaussians(trained, sh_degree=trained.sh_degree, features=False)
    training = TrainingSettings(backend=views.scene.backend)
    rates = {**_LEARNING_RATES, "means": _LEARNING_RATES["means"] * float(np.exp(np.median(trained.log_scales)))}
    random = np.random.default_rng(0)
    order: list[int] = []
    for step in range(settings.polish_steps):
        if should_stop():
            raise Cancelled("Stopped while polishing; no object was stored.")
        order = order or random.permutation(len(targets)).tolist()
        target = targets[order.pop()]
        parameters.track()
        raster = render(parameters.values, target.camera, training, sh_degree=trained.sh_degree)
        color = (raster.image - target.image).abs() * target.known[..., None]
        coverage = (1 - raster.transmittance - target.alpha).abs() * target.known
        (color.mean() + _COVERAGE_WEIGHT * coverage.mean()).backward()  # type: ignore[no-untyped-call]
        factor = _LAST_RATE ** (step / settings.polish_steps)
        parameters.step({name: factor * rate for name, rate in rates.items()})
    polished = parameters.to_gaussians(unit_features=False)
    return Polished(rows.astype(np.int32), trained.means, polished)


def _targets(
    views: Views, members: Mask, trained: Gaussians, settings: SegmentSettings, should_stop: StopCheck
) -> list[_Target]:
    low, high = np.percentile(trained.means, [2, 98], axis=0)
    hides = _IN_FRONT * float(np.linalg.norm(high - low)) / 2
    scene = Scene(_others_black(views.scene.gaussians, members), backend=views.scene.backend)
    alone = Scene(trained, backend=views.scene.backend)
    targets = []
    for camera in spread_cameras(views.facing(np.median(trained.means, axis=0)), settings.n_vote_views):
        if should_stop():
            raise Cancelled("Stopped while polishing; no object was stored.")
        target = _target(views.of(camera), scene, alone, members, hides)
        if target is not None:
            targets.append(target)
    return targets


def _target(view: View, scene: Scene, alone: Scene, members: Mask, hides: float) -> _Target | None:
    frame = view.frame
    channels = np.column_stack([members.astype(np.float32), scene.depth_of(frame)])
    seen = scene.render(frame, color=True, channels=channels)
    share = seen.channels[..., 3]
    if (share > 0.5).sum() < _FEWEST_PIXELS:
        return None
    depth = seen.channels[..., 4] / np.maximum(seen.alpha, 1e-3)
    by_itself = alone.render(frame, channels=alone.depth_of(frame)[:, None])
    own_depth = by_itself.channels[..., 0] / np.maximum(by_itself.alpha, 1e-3)
    hidden = (share < 0.5) & (depth < own_depth - hides)
    alpha = np.clip((share - _FAINT) / (_SOLID - _FAINT), 0, 1)
    alpha[eroded(share > 0.5, _RIM)] = 1
    image = seen.channels[..., :3] * (alpha / np.maximum(share, _FAINT))[..., None]
    part, camera = _around((by_itself.alpha > 0.02) | (share > _FAINT), frame)
    known = (view.within & ~hidden)[part].astype(np.float32)
    tensors = (torch.from_numpy(np.ascontiguousarray(one, np.float32)) for one in (image[part], alpha[part], known))
    return _Target(camera, *tensors)


def _others_black(gaussians: Gaussians, members: Mask) -> Gaussians:
    sh = np.where(members[:, None, None], gaussians.sh, np.float32(0))
    sh[~members, 0] = _BLACK
    return replace(gaussians, sh=sh)


def _around(mask: Mask, frame: PinholeCamera) -> tuple[tuple[slice, slice], PinholeCamera]:
    """Return the part of the picture that holds `mask` with a margin, and the camera of that part."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    top, bottom = max(0, rows[0] - _MARGIN), min(frame.height, rows[-1] + 1 + _MARGIN)
    left, right = max(0, columns[0] - _MARGIN), min(frame.width, columns[-1] + 1 + _MARGIN)
    K = frame.K.copy()
    K[0, 2] -= left
    K[1, 2] -= top
    return (slice(top, bottom), slice(left, right)), replace(
        frame, K=K, width=int(right - left), height=int(bottom - top)
    )
