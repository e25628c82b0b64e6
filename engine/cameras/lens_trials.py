"""Other lenses for a finished model: each photo its own, or of another kind, refined by bundle adjustment.

A model whose photos do not share the lens that they were given has a small reprojection error in wrong places. With
lenses of their own, the same photos then fit much better, and the lenses differ.
"""

from __future__ import annotations

import contextlib
import copy
import logging
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from threadpoolctl import threadpool_limits

from ..core.arrays import Float64
from ..core.child_process import ChildFailure, child_beside
from ..core.errors import CameraError, Cancelled, DiskError
from ..core.events import StopCheck, never_stop
from .colmap import pycolmap
from .colmap_calls import lens_of, require_free_space, translated, wait_for

_LARGEST_ERROR = 10.0
"""Pixels that one point counts at most: points that a trial throws behind a camera have no error."""
_ITERATIONS = 30
_POLL_SECONDS = 0.1
_WHAT = "trying other lenses"
_LOG = logging.getLogger(__name__)
_POINTS_PER_PHOTO = 80
"""Points of a trial for each placed photo. More change no finding and take longer."""


@dataclass(frozen=True)
class LensTrial:
    """A model with one lens per photo after bundle adjustment.

    Attributes
    ----------
    before, error : float
        Mean reprojection error of the points of the trial, as `capped_error` gives it, with the lenses of the model and
        with the refined ones; `error` is infinite when the adjustment failed.
    lenses : dict of int to pycolmap.Camera
        Refined lens by image id; empty when the adjustment failed.
    """

    before: float
    error: float
    lenses: dict[int, pycolmap.Camera]

    def focal_ratios(self, model: pycolmap.Reconstruction) -> dict[int, float]:
        """Return the focal length of each photo relative to that in `model`, by image id."""
        return {
            image_id: lens.mean_focal_length() / lens_of(model, image_id).mean_focal_length()
            for image_id, lens in self.lenses.items()
        }

    def aspects(self) -> Float64:
        """Return the horizontal focal length of each photo relative to the vertical one, shape [N]."""
        return np.array([lens.focal_length_x / lens.focal_length_y for lens in self.lenses.values()])

    def center_shifts(self) -> Float64:
        """Return how far each principal point lies from the middle of its photo, [N, 2], in sides of the photo."""
        return np.array(
            [
                (lens.principal_point_x / lens.width - 0.5, lens.principal_point_y / lens.height - 0.5)
                for lens in self.lenses.values()
            ]
        )


def capped_error(model: pycolmap.Reconstruction) -> float:
    """Return the mean reprojection error of the points in pixels, each capped at 10; 0 without points."""
    return _capped_mean([point.error for point in model.points3D.values()])


def _capped_mean(errors: list[float]) -> float:
    finite = np.nan_to_num(np.array(errors), nan=_LARGEST_ERROR)
    return float(np.minimum(finite, _LARGEST_ERROR).mean()) if len(finite) else 0.0


def with_aspect(lens: pycolmap.Camera) -> pycolmap.Camera:
    """Return an ``OPENCV`` lens, which has two focal lengths, that starts as `lens` without its distortion."""
    f, x, y = lens.mean_focal_length(), lens.principal_point_x, lens.principal_point_y
    return pycolmap.Camera(model="OPENCV", width=lens.width, height=lens.height, params=[f, f, x, y, 0, 0, 0, 0])


def tried_lenses(
    model: pycolmap.Reconstruction,
    change: Callable[[pycolmap.Camera], pycolmap.Camera] = copy.deepcopy,
    *,
    principal_point: bool = False,
    should_stop: StopCheck,
) -> LensTrial:
    """Return the lenses that fit each photo best; `model` is not changed.

    Parameters
    ----------
    change : callable
        Returns the lens to begin with for a lens of `model`.
    principal_point : bool
        Whether principal points are refined too.

    Raises
    ------
    Cancelled
        When `should_stop` returned True.
    """
    chosen = _points_of_trial(model)
    before = _capped_mean([model.point3D(point_id).error for point_id in chosen])
    trial = _with_own_lenses(model, chosen, change)
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_principal_point = principal_point
    options.print_summary = False
    # As in mapping, so that the result is the same in every run.
    options.ceres.solver_options.num_threads = 1
    options.ceres.solver_options.max_num_iterations = _ITERATIONS
    # Wrong matches that the shared lens let through must not decide.
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in trial.reg_image_ids():
        config.add_image(image_id)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    # Not `pycolmap.bundle_adjustment`, which turns COLMAP's log messages on.
    adjuster = pycolmap.create_default_bundle_adjuster(options, config, trial)
    try:
        wait_for(_WHAT, lambda token: adjuster.solve(), should_stop=should_stop)
    except CameraError:
        return LensTrial(before, float("inf"), {})
    trial.update_point_3d_errors()
    lenses = {image_id: lens_of(trial, image_id) for image_id in sorted(trial.reg_image_ids())}
    if not all(np.isfinite(lens.params).all() and lens.mean_focal_length() > 0 for lens in lenses.values()):
        return LensTrial(before, float("inf"), {})
    return LensTrial(before, capped_error(trial), lenses)


Kind = Literal["own", "everything"]
"""A lens for each photo, or two focal lengths and a principal point for each photo as well."""


def tried_apart(model: pycolmap.Reconstruction, kind: Kind, folder: Path, *, should_stop: StopCheck) -> LensTrial:
    """Return the trial of a kind as `tried_lenses` does, from a child process.

    COLMAP keeps Python's lock while it refines, so that no other thread goes on.

    Parameters
    ----------
    folder : Path
        The model is written below it, and deleted. Where that fails, the trial is made in this process.

    Raises
    ------
    Cancelled
        When `should_stop` returned True.
    """
    with contextlib.ExitStack() as ending:
        try:
            require_free_space(folder)
            with translated(_WHAT):
                place = ending.enter_context(
                    tempfile.TemporaryDirectory(prefix="trial-", dir=folder, ignore_cleanup_errors=True)
                )
                model.write(place)
            with child_beside(
                "cameras.lens_trials:trial_of_file", {"folder": place, "kind": kind}, what=_WHAT
            ) as child:
                while not child.finished:
                    if should_stop():
                        raise Cancelled(f"Stopped while {_WHAT}. The next run continues from here.")
                    time.sleep(_POLL_SECONDS)
                answer = child.end()
        except (ChildFailure, CameraError, DiskError) as failure:
            _LOG.warning("%s It is made in this process.", failure)
            return _tried(model, kind, should_stop=should_stop)
    if answer is None:
        raise Cancelled(f"Stopped while {_WHAT}. The next run continues from here.")
    lenses = {
        int(image_id): pycolmap.Camera(model=name, width=width, height=height, params=params)
        for image_id, (name, width, height, params) in answer["lenses"].items()
    }
    return LensTrial(answer["before"], float(answer["error"]), lenses)


def trial_of_file(folder: str, kind: Kind) -> dict[str, Any]:
    """Return a trial of the model in a folder as JSON values, in a child process."""
    with threadpool_limits(1, "blas"):
        trial = _tried(pycolmap.Reconstruction(folder), kind, should_stop=never_stop)
    lenses = {
        str(image_id): [lens.model.name, lens.width, lens.height, list(lens.params)]
        for image_id, lens in trial.lenses.items()
    }
    # JSON has no infinity.
    return {"before": trial.before, "error": repr(trial.error), "lenses": lenses}


def _tried(model: pycolmap.Reconstruction, kind: Kind, *, should_stop: StopCheck) -> LensTrial:
    if kind == "own":
        return tried_lenses(model, should_stop=should_stop)
    return tried_lenses(model, with_aspect, principal_point=True, should_stop=should_stop)


@dataclass(frozen=True)
class ModelTrials:
    """The trials that every model undergoes. Each takes a third of the time of mapping, so two are made at a time.

    Attributes
    ----------
    own : LensTrial
        With a lens for each photo.
    everything : Future of LensTrial, or None
        With two focal lengths and a principal point for each photo as well; None where it is not begun.
    """

    own: LensTrial
    everything: Future[LensTrial] | None = None

    @classmethod
    def begun(
        cls, model: pycolmap.Reconstruction, folder: Path, beside: Executor, *, should_stop: StopCheck
    ) -> ModelTrials:
        """Return the trials of `model`, which must not change; one goes on in a process that `beside` waits for.

        `folder` is for what this process reads.
        """
        everything = beside.submit(tried_apart, model, "everything", folder, should_stop=should_stop)
        return cls(tried_lenses(model, should_stop=should_stop), everything)

    def with_everything(self, model: pycolmap.Reconstruction, *, should_stop: StopCheck) -> LensTrial:
        """Return the trial `everything` of `model`, which is made now where it is not begun."""
        if self.everything is None:
            return _tried(model, "everything", should_stop=should_stop)
        return self.everything.result()


def _points_of_trial(model: pycolmap.Reconstruction) -> list[int]:
    """Return the ids of the points that most photos see, in the order of their ids."""
    count = _POINTS_PER_PHOTO * model.num_reg_images()
    by_length = sorted(model.points3D, key=lambda point_id: (-model.point3D(point_id).track.length(), point_id))
    return sorted(by_length[:count])


def _with_own_lenses(
    model: pycolmap.Reconstruction, point_ids: list[int], change: Callable[[pycolmap.Camera], pycolmap.Camera]
) -> pycolmap.Reconstruction:
    """Return a copy of the placed photos and some points of `model` in which every photo has a lens of its own."""
    trial = pycolmap.Reconstruction()
    for image_id in sorted(model.reg_image_ids()):
        image = model.image(image_id)
        lens = change(lens_of(model, image_id))
        lens.camera_id = image_id
        trial.add_camera_with_trivial_rig(lens)
        own = pycolmap.Image(name=image.name, camera_id=image_id, image_id=image_id)
        own.points2D = pycolmap.Point2DList([pycolmap.Point2D(point.xy) for point in image.points2D])
        trial.add_image_with_trivial_frame(own, image.cam_from_world())
    for point_id in point_ids:
        point = model.points3D[point_id]
        trial.add_point3D(point.xyz, point.track, point.color)
    return trial
