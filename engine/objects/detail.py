"""Detail: the Gaussians of an object are trained further on the photos that show it, at the photos' own resolution.

A scene is trained on reduced photos, and an object covers a small part of each. In the scene its front may also be
translucent, because what is behind it has the same colour, and a Gaussian may reach into a wall that hides it. Without
the scene, the first is a hole and the second a spike. The scene itself stays as it is.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ..cameras import training_pinhole, undistort
from ..core.arrays import Float32, Mask
from ..core.errors import Cancelled
from ..core.events import StopCheck
from ..masks import mask_box
from ..photos import load_with_valid
from ..pictures import Rendered, Scene
from ..pictures.settings import VISIBLE_SHARE
from ..project.folder import ProjectFolder
from ..scene import Camera, Detailed, Gaussians, PinholeCamera
from ..training import DetailCrop, DetailPlan, detail_psnr, train_detail
from .context import photo_folder_of
from .settings import SegmentSettings
from .views import MIN_VISIBLE_PIXELS, Views, erode_mask, inner_box, spread_cameras

__all__ = ["DetailPhotos", "DetailResult", "detail_object"]

_MIN_SHARE = 0.3  # chosen on museum_room
"""Share of a pixel that the object contributes in the scene at which the coverage that it has alone starts to rise; it
is 1 at one minus this."""

_OCCLUDER_DISTANCE = 0.25  # chosen on museum_room
"""Distance in front of the object, in its radii, from which on other Gaussians hide it. What is closer is the wall or
support that a Gaussian of the object reaches into."""

_AGREEING = 0.12  # chosen on museum_room
"""Largest mean difference between colours of the object alone and those of the photo, 0 to 1, at which they agree."""

_RIM_SHARE = 1 / 300
"""Width of the edge that may be translucent, as a share of the longer side of the photo that the scene was seen in."""

_MARGIN = 0.08
"""Margin around the object in a crop, as a share of its box."""

_COMPARED_SHARE = 0.02
"""Share of a pixel that the object contributes from which on the pixel, with a margin, is compared with the photo."""

_MAX_SIDE = 4096
"""Longest side, in pixels, at which a photo is read. Larger ones are reduced, which the result says."""

_MAP_PIXELS = 600_000
"""Largest maps of a crop, in pixels: where it shows the object. The scene, trained on small photos, knows no more."""

_MAX_PIXELS = 160_000_000
"""Pixels of all crops together, 3 bytes each. If they have more, all are reduced, which the result says."""

_MAX_PHOTOS = 40
"""Photos of which crops are made, those that differ most: each takes memory, and the steps are the same for more."""

_MIN_PHOTOS = 3
"""Photos that an object needs: fewer say nothing of how deep a detail is."""

_VALIDATION_SHARE, _MAX_VALIDATION = 0.12, 4
"""Share of the training photos that decide whether the detail is kept, where no test photo shows the object, and the
largest number of photos that decide."""

_MIN_GAIN = 0.02
"""Gain on these photos, in dB, below which the detail is not kept."""

_PIXELS_PER_GAUSSIAN = 8  # chosen on museum_room
"""Pixels of the object, on all its sides, for each Gaussian that it gets at most."""

_SIDES = 3
"""Surface of an object in pixels, relative to its pixels in one photo at the median."""

_MAX_GROWTH = 6
"""Largest number of Gaussians, relative to those that the object has, where the photos are little finer than those that
the scene was trained on. Finer photos allow more, by their pixels."""

_PIXELS_SEEN = 100
"""Pixels that all steps together compare, for each Gaussian that there may be: fewer would not determine it."""

_PIXELS_FOR_STEPS = 300_000
"""Pixels of the object in one photo up to which `SegmentSettings.detail_steps` are enough. Larger objects get more, by
the root of their pixels."""

_MAX_MORE_STEPS = 3
"""Largest number of steps, relative to that."""

_PREPARATION = 0.2
"""Share of the time in which the crops are made, for the progress."""


@dataclass(frozen=True)
class DetailPhotos:
    """The photos of a project as detail uses them.

    Attributes
    ----------
    folder : Path
    held_out : collection of str
        Names of the test photos, which nothing is trained on; they decide whether detail is kept.
    gains : mapping of str to sequence of 3 float
        Brightness of photos relative to the scene; 1 for others.
    masks : mapping of str to Path
        Files of the masks of valid pixels by photo.
    trained_side : int
        Longer side of the photos as the scene was trained on them, in pixels.
    """

    folder: Path
    held_out: frozenset[str] = frozenset()
    gains: Mapping[str, Sequence[float]] = field(default_factory=dict)
    masks: Mapping[str, Path] = field(default_factory=dict)
    trained_side: int = 640

    def gain(self, photo: str) -> Float32:
        """Return the brightness of a photo relative to the scene, [3]."""
        return np.asarray(self.gains.get(photo, (1.0, 1.0, 1.0)), np.float32)

    @classmethod
    def of(cls, project: ProjectFolder) -> DetailPhotos:
        """Return the photos of a trained project.

        Raises
        ------
        FormatError
            When the project does not name their folder.
        """
        from ..scene import read_photo_set

        record = project.stage_record("training") or {}
        figures, given = record.get("figures", {}), (record.get("run") or {}).get("settings") or {}
        plan = project.get("plan")
        held_out = plan.get("held_out", ()) if isinstance(plan, dict) else ()
        masks: Mapping[str, Path] = {}
        if (listing := project.path / "photos" / "photos.json").is_file():
            masks = read_photo_set(listing).mask_files
        side = given.get("max_side")
        trained_side = side if isinstance(side, int) and side > 0 else cls.trained_side
        return cls(photo_folder_of(project), frozenset(held_out), figures.get("exposure") or {}, masks, trained_side)


@dataclass(frozen=True)
class DetailResult:
    """What detailing an object came to.

    Attributes
    ----------
    detailed : Detailed or None
        None when it was not kept.
    record : dict
        Figures for the object's record: ``kept``, ``why`` not, ``photos``, ``validation``, ``reduced`` photos and the
        ``scale`` that they were read at, relative to their own, ``pixels`` of the object at the median, ``steps``,
        ``gaussians``, ``psnr`` before and after, the ``device`` of the steps, ``seconds``.
    """

    detailed: Detailed | None
    record: dict[str, Any]

    @property
    def sentence(self) -> str:
        """What a user is told."""
        record = self.record
        if not record["kept"]:
            return f"The object stays as it is in the scene: {record['why']}."
        before, after = record["psnr"]
        text = f"{after - before:+.1f} dB on photos that were left out, {record['gaussians'][1]:,} Gaussians"
        return text + (f"; {record['reduced']} photos were read smaller" if record["reduced"] else "")


def detail_object(
    views: Views,
    photos: DetailPhotos,
    members: Mask,
    settings: SegmentSettings,
    *,
    should_stop: StopCheck,
    tell: Callable[[float, float | None], None] = lambda done, seconds_left: None,
) -> DetailResult:
    """Train an object's Gaussians on the parts of the photos that show it.

    Parameters
    ----------
    views : Views
    photos : DetailPhotos
    members : array of shape [N], bool
    settings : SegmentSettings
        Of them, `detail_steps`.
    should_stop : callable
    tell : callable
        Called with the fraction that is done, 0 to 1, and the seconds that are left where they are known.

    Raises
    ------
    Cancelled
        When `should_stop` returns True.
    PhotoError
        When a photo cannot be read.

    Notes
    -----
    Let s be the share of a pixel that the members contribute in the whole scene. The coverage of the object alone is to
    be (s - 0.3) / 0.4, clipped to [0, 1], and 1 inside its outline. Where it covers more alone, and has the colours of
    the photo there, it keeps that. Pixels in which other Gaussians are clearly in front of the object do not count.
    Colours come from the photos alone. The result is kept when it is better on the test photos, which neither the scene
    nor the detail was trained on. Figures: docs/detail.md.
    """
    started, rows = time.perf_counter(), np.flatnonzero(members)
    record: dict[str, Any] = {"kept": False, "steps": settings.detail_steps}
    if settings.detail_steps == 0 or len(rows) == 0:
        return DetailResult(None, {**record, "why": "no steps were asked for" if len(rows) else "it is empty"})
    gaussians = views.scene.gaussians
    trained = replace(gaussians[rows], features=None)
    facing = views.facing(np.median(trained.means, axis=0))
    cameras = spread_cameras([one for one in facing if one.photo not in photos.held_out], _MAX_PHOTOS)
    tests = spread_cameras([one for one in facing if one.photo in photos.held_out], _MAX_VALIDATION)
    cutter = _Cutter(views, photos, members, trained)
    parts = [cutter.part(camera) for camera in [*cameras, *tests]]
    cutter.scale = min(1.0, math.sqrt(_MAX_PIXELS / max(1, sum(one.width * one.height for one in parts if one))))
    crops: list[DetailCrop] = []
    for number, (camera, part) in enumerate(zip([*cameras, *tests], parts, strict=True)):
        if should_stop():
            raise Cancelled("Stopped while detailing; nothing was stored.")
        if part is not None:
            crops.append(cutter.crop(camera, part))
        tell(_PREPARATION * ((number + 1) / len(parts)), None)
    crops.sort(key=lambda crop: crop.photo)
    training, validation = ([one for one in crops if (one.photo in photos.held_out) is held] for held in (False, True))
    if len(training) < _MIN_PHOTOS:
        return DetailResult(None, {**record, "why": f"only {len(training)} training photos show it, and it needs 3"})
    training = _weighted(training)
    if not validation:
        training, validation = _divided(training)
    n_pixels = float(np.median([crop.pixels_of(crop.inside) for crop in training]))
    plan = _plan(settings.detail_steps, len(rows), n_pixels, cutter.finer)
    backend = views.scene.backend
    others = replace(gaussians[np.flatnonzero(~members)], features=None)
    result, parents = train_detail(
        trained, others, training, plan, backend=backend, should_stop=should_stop,
        tell=lambda done, left: tell(_PREPARATION + (1 - _PREPARATION) * done, left),
    )  # fmt: skip
    before, after = (detail_psnr(one, validation, backend=backend) for one in (trained, result))
    record |= {
        "photos": len(training), "validation": [crop.photo for crop in validation], "reduced": cutter.n_reduced,
        "scale": round(cutter.scale, 3), "pixels": round(n_pixels), "gaussians": [len(trained), len(result)],
        "steps": plan.steps, "device": "card" if backend == "gpu" else "processor",
        "psnr": [round(before, 2), round(after, 2)], "seconds": round(time.perf_counter() - started, 1),
    }  # fmt: skip
    if not after >= before + _MIN_GAIN:
        return DetailResult(
            None, {**record, "why": f"photos that were left out show no gain ({after - before:+.1f} dB)"}
        )
    order = np.argsort(parents, kind="stable")
    scene_rows = rows.astype(np.int32)
    kept = Detailed(scene_rows, trained.means, scene_rows[parents[order]], result[order])
    return DetailResult(kept, {**record, "kept": True})


def _plan(n_steps: int, n: int, n_pixels: float, finer: float) -> DetailPlan:
    """Return how much an object of `n` Gaussians and `n_pixels` in one photo is trained.

    `finer` is the photo's scale relative to that of the scene's training.
    """
    steps = round(n_steps * min(_MAX_MORE_STEPS, max(1.0, math.sqrt(n_pixels / _PIXELS_FOR_STEPS))))
    plan = DetailPlan(steps, n)
    surface = max(n, _SIDES * n_pixels / _PIXELS_PER_GAUSSIAN)
    determined = max(_MAX_GROWTH * n, steps * plan.window_pixels / _PIXELS_SEEN)
    return replace(plan, max_gaussians=round(min(surface, determined, max(_MAX_GROWTH, finer**2) * n)))


@dataclass
class _Cutter:
    """Cuts the parts that show an object out of photos.

    Attributes
    ----------
    scale : float
        Scale of all parts relative to the photos' own.
    n_reduced : int
        Photos that were read smaller than they are.
    """

    views: Views
    photos: DetailPhotos
    members: Mask
    trained: Gaussians
    scale: float = 1.0
    n_reduced: int = 0

    def __post_init__(self) -> None:
        low, _, high = inner_box(self.trained.means)
        self._occluder_distance = _OCCLUDER_DISTANCE * float(np.linalg.norm(high - low)) / 2
        self._alone = self.views.scene.with_gaussians(self.trained)

    @property
    def finer(self) -> float:
        """How much larger the photos are read than the scene saw them, at the median."""
        sides = [max(one.width, one.height) for one in self.views.cameras.cameras]
        return self.scale * min(float(np.median(sides)), _MAX_SIDE) / self.photos.trained_side

    def crop(self, camera: Camera, part: PinholeCamera) -> DetailCrop:
        """Return a part of a photo that shows the object."""
        full = training_pinhole(camera, max_side=_MAX_SIDE)
        part = _resized(part, self.scale)
        source_side = math.ceil(max(camera.width, camera.height) * part.K[0, 0] / full.K[0, 0])
        self.n_reduced += self.scale < 0.999 or max(camera.width, camera.height) > _MAX_SIDE
        source, source_valid = load_with_valid(
            self.photos.folder / camera.photo, self.photos.masks.get(camera.photo),
            max_side=source_side, over_black=True,
        )  # fmt: skip
        pixels = undistort(source, camera, part, interpolation="linear")
        small = _resized(part, min(1.0, math.sqrt(_MAP_PIXELS / (part.width * part.height))))
        shown = cv2.resize(pixels, (small.width, small.height), interpolation=cv2.INTER_AREA)
        valid = np.ones(shown.shape[:2], bool)
        if source_valid is not None:
            valid = undistort(source_valid.astype(np.float32), camera, small, interpolation="linear") > 1.0 - 1e-4
        gain = self.photos.gain(camera.photo)
        share, alpha, hidden, isolated = self._coverage(small)
        # What the object covers alone and not in the scene is a spike, or a part of it that others show there as well.
        # The photo tells which.
        covered = isolated.alpha[..., None]
        difference = np.abs(isolated.channels[..., :3] * gain - covered * shown / np.float32(255)).mean(axis=2)
        agrees = (share <= VISIBLE_SHARE) & (isolated.alpha > VISIBLE_SHARE) & ~hidden
        agrees &= cv2.blur(difference, (5, 5)) < _AGREEING * isolated.alpha
        alpha = np.where(agrees, isolated.alpha, alpha)
        visible, known = share > VISIBLE_SHARE, valid & ~hidden
        rim = max(1, round(_RIM_SHARE * max(full.width, full.height) * small.K[0, 0] / full.K[0, 0]))
        inside = erode_mask(visible, rim) & visible
        alpha = np.where(inside, np.float32(1), alpha)
        kernel = np.ones((2 * rim + 1, 2 * rim + 1), np.uint8)
        compared = cv2.dilate((share > _COMPARED_SHARE).astype(np.uint8), kernel) > 0
        return DetailCrop(
            camera.photo, part, np.ascontiguousarray(pixels), compared & valid, inside & valid,
            (inside | agrees) & valid, alpha.astype(np.float32), known, gain, float(visible.sum()),
        )  # fmt: skip

    def part(self, camera: Camera) -> PinholeCamera | None:
        """Return the camera of the part of a photo that shows the object; None where it hardly does."""
        frame = training_pinhole(camera, max_side=_MAX_SIDE)
        small = training_pinhole(camera, max_side=self.views.render_side)
        share = self.views.scene.share(small, self.members)
        if (share > VISIBLE_SHARE).sum() < MIN_VISIBLE_PIXELS:
            return None
        box = mask_box(share > _MIN_SHARE)
        assert box is not None, "the object is visible in this view"
        scale = frame.K[0, 0] / small.K[0, 0]
        margins = [_MARGIN * (box[2] - box[0]) + 2, _MARGIN * (box[3] - box[1]) + 2]
        left, top = (max(0, math.floor((box[i] - margins[i]) * scale)) for i in (0, 1))
        right = min(frame.width, math.ceil((box[2] + margins[0]) * scale))
        bottom = min(frame.height, math.ceil((box[3] + margins[1]) * scale))
        K = frame.K - np.array([[0, 0, left], [0, 0, top], [0, 0, 0]])
        return replace(frame, K=K, width=right - left, height=bottom - top)

    def _coverage(self, part: PinholeCamera) -> tuple[Float32, Float32, Mask, Rendered]:
        """Return the object's share of each pixel, its coverage by it, where something hides it, and it alone."""
        scene: Scene = self.views.scene
        channels = np.column_stack([self.members.astype(np.float32), scene.depth_of(part)])
        in_scene = scene.render(part, channels=channels)
        isolated = self._alone.render(part, color=True, channels=self._alone.depth_of(part)[:, None])
        share = in_scene.channels[..., 0]
        # Mean depths are compared, times both alphas, which may be 0.
        farthest = (isolated.channels[..., 3] - self._occluder_distance * isolated.alpha) * in_scene.alpha
        hidden = (share < VISIBLE_SHARE) & (in_scene.channels[..., 1] * isolated.alpha < farthest)
        return share, np.clip((share - _MIN_SHARE) / (1 - 2 * _MIN_SHARE), 0, 1), hidden, isolated


def _resized(camera: PinholeCamera, scale: float) -> PinholeCamera:
    """Return the camera of the picture at this scale, rounded to whole pixels."""
    width, height = (max(1, round(side * scale)) for side in (camera.width, camera.height))
    factors = np.array([width / camera.width, height / camera.height, 1.0])
    return replace(camera, K=camera.K * factors[:, None], width=width, height=height)


def _divided(crops: Sequence[DetailCrop]) -> tuple[list[DetailCrop], list[DetailCrop]]:
    """Return crops to train on and to decide by, where no test photo shows the object.

    The scene was trained on the second ones too, so that they favour the object as it is.
    """
    n_validation = min(_MAX_VALIDATION, max(1, round(_VALIDATION_SHARE * len(crops))))
    chosen = {round((i + 0.5) * len(crops) / n_validation - 0.5) for i in range(n_validation)}
    return [one for i, one in enumerate(crops) if i not in chosen], [crops[i] for i in sorted(chosen)]


def _weighted(crops: Sequence[DetailCrop]) -> list[DetailCrop]:
    """Return crops whose weights are larger where the photo is near and sharp."""
    sharpness = []
    for crop in crops:
        gray = cv2.cvtColor(crop.reduced(20_000).pixels, cv2.COLOR_RGB2GRAY).astype(np.float32)
        sharpness.append(float(np.abs(cv2.Laplacian(gray, cv2.CV_32F)).mean()))
    middle = max(float(np.median(sharpness)), 1e-6)
    return [
        replace(crop, weight=math.sqrt(crop.weight) * float(np.clip(sharp / middle, 0.5, 2.0)))
        for crop, sharp in zip(crops, sharpness, strict=True)
    ]
