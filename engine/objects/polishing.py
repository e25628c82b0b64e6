"""Polishing: further training of an object's Gaussians, so that it is opaque and ends at its outline without the scene.

In the scene the front of an object may be translucent, because what is behind it has the same colour, and a Gaussian
may reach into a wall that hides it. Without the scene, the first is a hole and the second a spike.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from ..core.arrays import Mask
from ..core.errors import Cancelled
from ..core.events import StopCheck
from ..formats import SH_C0
from ..masks import mask_box
from ..pictures import Backend, Scene
from ..pictures.settings import VISIBLE_SHARE
from ..scene import Polished
from ..training import AloneTarget, train_alone
from .settings import SegmentSettings
from .views import MIN_VISIBLE_PIXELS, View, Views, erode_mask, inner_box, spread_cameras

__all__ = ["polish"]

_MIN_SHARE = 0.3  # chosen on museum_room
"""Share of a pixel that the object contributes in the scene at which its target coverage starts to rise; it is 1 at one
minus this."""

_OCCLUDER_DISTANCE = 0.25  # chosen on museum_room
"""Distance in front of the object, in its radii, from which on other Gaussians hide it. What is closer is the wall or
support that a Gaussian of the object reaches into."""

_RIM_PIXELS = 2  # chosen on museum_room
"""Width in pixels of the edge that may be translucent. Inside of it, pixels that mostly show the object are opaque."""

_MARGIN_PIXELS = 8
"""Margin around the object in the part of a view that is rendered."""

_BLACK_SH = -1 / (2 * SH_C0)
"""Lowest band of the spherical harmonics of a black Gaussian: colour = 1/2 + `SH_C0` sh."""


def polish(views: Views, members: Mask, settings: SegmentSettings, *, should_stop: StopCheck) -> Polished | None:
    """Train an object's Gaussians further until, rendered without the scene, it looks as it does in the scene.

    Let s be the share of a pixel that the members contribute in the whole scene. The target coverage is
    (s - 0.3) / 0.4, clipped to [0, 1], and the target colour is the members' own blended colour, divided by s and
    multiplied by the coverage. No photo is needed, and no colour of the background is mixed in. Pixels in which other
    Gaussians are clearly in front of the object do not count. Figures: docs/polished_objects.md.

    Parameters
    ----------
    views : Views
    members : array of shape [N], bool
    settings : SegmentSettings
        Of them, `polish_steps` and `n_vote_views`.
    should_stop : callable

    Returns
    -------
    Polished or None
        None without steps, without members, and if no view shows them.

    Raises
    ------
    Cancelled
        When `should_stop` returns True.
    """
    rows = np.flatnonzero(members)
    if settings.polish_steps == 0 or len(rows) == 0:
        return None
    gaussians = views.scene.gaussians
    trained = replace(gaussians[rows], features=None)
    low, _, high = inner_box(trained.means)
    occluder_distance = _OCCLUDER_DISTANCE * float(np.linalg.norm(high - low)) / 2
    sh = np.where(members[:, None, None], gaussians.sh, np.float32(0))
    sh[~members, 0] = _BLACK_SH
    others_black, alone = views.scene.with_gaussians(replace(gaussians, sh=sh)), views.scene.with_gaussians(trained)
    targets = []
    for camera in spread_cameras(views.facing(np.median(trained.means, axis=0)), settings.n_vote_views):
        if should_stop():
            raise Cancelled("Stopped while polishing; no object was stored.")
        targets += _targets(views.of(camera), others_black, alone, members, occluder_distance)
    if not targets:
        return None
    # Few Gaussians in small parts of views: a card would wait for copies in each step.
    backend: Backend = "cpu" if views.scene.backend == "gpu" else views.scene.backend
    polished = train_alone(trained, targets, steps=settings.polish_steps, backend=backend, should_stop=should_stop)
    return Polished(rows.astype(np.int32), trained.means, polished)


def _targets(view: View, scene: Scene, alone: Scene, members: Mask, occluder_distance: float) -> list[AloneTarget]:
    """Return the target that a view makes, and none where it hardly shows the object."""
    frame = view.frame
    channels = np.column_stack([members.astype(np.float32), scene.depth_of(frame)])
    in_scene = scene.render(frame, color=True, channels=channels)
    share = in_scene.channels[..., 3]
    if (share > VISIBLE_SHARE).sum() < MIN_VISIBLE_PIXELS:
        return []
    isolated = alone.render(frame, channels=alone.depth_of(frame)[:, None])
    # Mean depths are compared, times both alphas, which may be 0.
    farthest = (isolated.channels[..., 0] - occluder_distance * isolated.alpha) * in_scene.alpha
    hidden = (share < VISIBLE_SHARE) & (in_scene.channels[..., 4] * isolated.alpha < farthest)
    alpha = np.clip((share - _MIN_SHARE) / (1 - 2 * _MIN_SHARE), 0, 1)
    alpha[erode_mask(share > VISIBLE_SHARE, _RIM_PIXELS)] = 1
    image = in_scene.channels[..., :3] * (alpha / np.maximum(share, _MIN_SHARE))[..., None]
    # Only the part of the view that shows the object is rendered.
    box = mask_box((isolated.alpha > _MIN_SHARE) | (share > _MIN_SHARE))
    assert box is not None, "the object is visible in this view"
    left, top = (max(0, side - _MARGIN_PIXELS) for side in box[:2])
    right, bottom = min(frame.width, box[2] + _MARGIN_PIXELS), min(frame.height, box[3] + _MARGIN_PIXELS)
    K = frame.K - np.array([[0, 0, left], [0, 0, top], [0, 0, 0]])
    arrays = (array[top:bottom, left:right] for array in (image, alpha, view.within & ~hidden))
    tensors = (torch.from_numpy(np.ascontiguousarray(array, np.float32)) for array in arrays)
    return [AloneTarget(replace(frame, K=K, width=right - left, height=bottom - top), *tensors)]
