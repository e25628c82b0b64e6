"""Triangulation of sparse points for given, fixed poses from matched features."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float64
from ..core.errors import CameraError
from ..core.events import Emit, StopCheck
from ..scene import Camera, PhotoSet
from .colmap import pycolmap
from .colmap_calls import opened_database, wait_for
from .features import SfmWorkspace, match_posed_photos
from .normalise import normalised_viewmat, original_from_world
from .reconstruction import points_of
from .settings import CameraSettings


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
        Only photos with a camera are matched.
    folder : Path
        Work folder.
    emit, should_stop
        As in `estimate_cameras`.

    Raises
    ------
    CameraError
        When no point could be triangulated.
    """
    by_photo = {camera.photo: camera for camera in cameras}
    workspace = match_posed_photos(cameras, photo_set, settings, folder, emit=emit, should_stop=should_stop)
    # Normalised, because COLMAP's thresholds and float precision suit unit sizes near the origin.
    similarity = original_from_world([camera.viewmat for camera in cameras], np.zeros((0, 3)))
    model = posed_model(workspace, by_photo, similarity)
    options = pycolmap.IncrementalPipelineOptions()
    options.random_seed = settings.seed
    # As in `sfm`, so that the points are the same in every run.
    options.num_threads = 1
    workspace.sparse.mkdir(parents=True, exist_ok=True)
    model = wait_for(
        "triangulating points",
        lambda token: pycolmap.triangulate_points(
            model, workspace.database, workspace.images, workspace.sparse, True, options, False, token
        ),
        should_stop=should_stop,
    )
    points, colors = points_of(model)
    if len(points) == 0:
        raise CameraError(
            "No points could be triangulated from the given cameras: they do not fit these photos, or the photos "
            "do not overlap."
        )
    return points @ similarity[:3, :3].T + similarity[:3, 3], colors, model.compute_mean_reprojection_error()


def posed_model(workspace: SfmWorkspace, by_photo: dict[str, Camera], similarity: Float64) -> pycolmap.Reconstruction:
    """Return a model with the given poses, and with the lenses and ids of the database.

    `similarity`, [4, 4], takes the world of the model to that of the poses.
    """
    model = pycolmap.Reconstruction()
    with opened_database(workspace.database) as database:
        for lens in database.read_all_cameras():
            model.add_camera_with_trivial_rig(lens)
        images = sorted(database.read_all_images(), key=lambda image: image.image_id)
    for image in images:
        camera = by_photo[workspace.copy_of(image.name).photo.name]
        viewmat = normalised_viewmat(camera.viewmat, similarity)
        rotation = pycolmap.Rotation3d(np.ascontiguousarray(viewmat[:3, :3]))
        posed_image = pycolmap.Image(name=image.name, camera_id=image.camera_id, image_id=image.image_id)
        model.add_image_with_trivial_frame(posed_image, pycolmap.Rigid3d(rotation, viewmat[:3, 3]))
    return model
