"""Sparse points for given poses: features are matched and triangulated, the poses stay as they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray

from ..errors import CameraError
from ..events import Emit, Progress, StopCheck
from ..scene import Camera, PhotoSet
from .colmap_calls import threads_for_colmap, wait_for
from .features import Workshop, match_features
from .normalise import normalised_viewmat, original_from_world
from .reconstruction import points_of
from .settings import CameraSettings

__all__ = ["triangulate"]

Float64 = NDArray[np.float64]


def triangulate(
    cameras: list[Camera],
    photo_set: PhotoSet,
    folder: Path,
    settings: CameraSettings,
    *,
    emit: Emit,
    should_stop: StopCheck,
) -> tuple[Float64, NDArray[np.uint8], float]:
    """Return points [P, 3] in the frame of `cameras`, colours [P, 3] and the mean reprojection error in pixels.

    Parameters
    ----------
    cameras : list of Camera
        At least two.
    photo_set : PhotoSet
        Only the photos with a camera are matched.
    folder : Path
        Work folder.
    settings : CameraSettings
    emit, should_stop
        As in `sfm.estimate_cameras`.

    Raises
    ------
    CameraError
        When no point could be triangulated.
    """
    by_photo = {camera.photo: camera for camera in cameras}
    with_camera = tuple(photo for photo in photo_set.photos if photo.name in by_photo)
    workshop = Workshop(folder, PhotoSet(photo_set.folder, with_camera, ()), settings, by_photo)
    match_features(
        workshop,
        report=lambda done, message: emit(Progress("cameras", 0.9 * done, None, message)),
        should_stop=should_stop,
    )
    # Near the origin and at unit size: COLMAP's thresholds and digits are made for that.
    similarity = original_from_world([camera.viewmat for camera in cameras], np.zeros((0, 3)))
    model = _posed_model(workshop, by_photo, similarity)
    options = pycolmap.IncrementalPipelineOptions()
    options.random_seed = settings.seed
    options.num_threads = threads_for_colmap(settings.threads)
    workshop.sparse.mkdir(parents=True, exist_ok=True)
    model = wait_for(
        "triangulating points",
        lambda token: pycolmap.triangulate_points(
            model, workshop.database, workshop.images, workshop.sparse, True, options, False, token
        ),
        report=lambda: None,
        should_stop=should_stop,
    )
    points, colors = points_of(model)
    if len(points) == 0:
        raise CameraError(
            "No points could be triangulated from the given cameras: they do not fit these photos, or the photos "
            "do not overlap."
        )
    return points @ similarity[:3, :3].T + similarity[:3, 3], colors, model.compute_mean_reprojection_error()


def _posed_model(workshop: Workshop, by_photo: dict[str, Camera], similarity: Float64) -> pycolmap.Reconstruction:
    """Return a model with the given poses, and the database's lenses (which are the given ones) and ids."""
    model = pycolmap.Reconstruction()
    with pycolmap.Database.open(workshop.database) as database:
        for lens in database.read_all_cameras():
            model.add_camera_with_trivial_rig(lens)
        images = sorted(database.read_all_images(), key=lambda image: image.image_id)
    for image in images:
        camera = by_photo[workshop.copy_of(image.name).photo.name]
        viewmat = normalised_viewmat(camera.viewmat, similarity)
        rotation = pycolmap.Rotation3d(np.ascontiguousarray(viewmat[:3, :3]))
        placed = pycolmap.Image(name=image.name, camera_id=image.camera_id, image_id=image.image_id)
        model.add_image_with_trivial_frame(placed, pycolmap.Rigid3d(rotation, viewmat[:3, 3]))
    return model
