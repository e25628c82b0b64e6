"""Camera poses supplied by the user: a COLMAP model, or what other programs export.

Conventions at input: COLMAP poses are world-to-camera with x right, y down, z forward; poses of other programs are
converted where they are read. Units and world axes of the model are arbitrary and are normalised.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from ..core.errors import CameraError, FormatError, HeritageError
from ..core.events import Emit, StopCheck, Warned, ignore_events, never_stop
from ..scene import Camera, CameraSet, NameMatches, Photo, PhotoSet, camera_problem, match_names
from .exports import cameras_of, read_export
from .joining import Part, joined_parts
from .match_evidence import orientations_by_matches
from .model_places import ModelPlace, find_export, find_models
from .model_reading import ModelImage, SparsePoints, read_cloud, read_model
from .orientation import GivenCamera, choose_orientations, upright_cameras
from .reconstruction import camera_set
from .settings import CameraSettings
from .transforms_json import read_transforms_json
from .triangulation import triangulate
from .turning import ORIENTATIONS
from .undistortion import require_valid_lens


def read_cameras(
    model: Path,
    photo_set: PhotoSet,
    settings: CameraSettings | None = None,
    *,
    folder: Path | None = None,
    emit: Emit = ignore_events,
    should_stop: StopCheck = never_stop,
) -> CameraSet:
    """Return the cameras of an existing model for the photos in `photo_set`, in the normalised world.

    Parameters
    ----------
    model : Path
        Folder of a COLMAP model (``cameras``, ``images``, ``points3D`` as ``.bin`` or ``.txt``) or of a project with
        one in a usual place (`model_places.find_models`); or a file or folder that `model_places.find_export` knows.
    photo_set : PhotoSet
        Photos of the model, identified by `engine.scene.match_names`.
    settings : CameraSettings, optional
        Settings of the matching that a model without points requires.
    folder : Path, optional
        Work folder for this matching; by default a temporary one.
    emit : Emit
        Receives a `Warned` when the model has several parts, and the progress of this matching.

    Returns
    -------
    CameraSet
        ``original_from_world`` maps to the frame of the model in the file, which may be georeferenced. Cameras of
        resized, turned or mirrored copies are those of the photos (`orientation`).

    Raises
    ------
    CameraError
        When the model is missing or cannot be read, when its pictures are not the photos, when a name may mean several
        photos, or when it cannot be found out which way pictures were turned.
    FormatError
        When a file of the model cannot be opened, or ``transforms.json`` is not what its format demands.
    Cancelled
        When `should_stop` returned True.

    Notes
    -----
    Of several places with models, the one that fits the most photos is used. ``applied_transform`` and
    ``applied_scale`` of nerfstudio are ignored: the original frame is that of the poses in the file. When a model has
    no points, points are triangulated from matched features with the given poses fixed.
    """
    settings = settings or CameraSettings()
    places = find_models(model)
    if places:
        given, points = _from_models(model, places, photo_set, emit, should_stop)
    else:
        given, points = _from_export(model, photo_set, emit, should_stop)
    choice = choose_orientations(given, points, photo_set.folder, model, should_stop)
    with ExitStack() as ending:
        work = folder or Path(ending.enter_context(tempfile.TemporaryDirectory(prefix="gaussian-heritage-")))
        chosen = choice.chosen
        if choice.open:
            chosen = orientations_by_matches(
                given, choice, model, photo_set, settings, work, emit=emit, should_stop=should_stop
            )
        cameras, points = upright_cameras(given, chosen, points, model)
        _require_usable_cameras(cameras, model)
        if len(points.positions) == 0 and len(cameras) >= 2:
            points = SparsePoints(*triangulate(cameras, photo_set, work, settings, emit=emit, should_stop=should_stop))
    return camera_set(
        cameras,
        (photo.name for photo in photo_set.photos),
        points.positions,
        points.colors,
        reprojection_error=points.reprojection_error,
        poses_given=True,
    )


def has_points(model: Path) -> bool:
    """Return whether a model appears to have sparse points, without reading them.

    Raises
    ------
    CameraError
        When the model is missing.
    """
    if find_models(model):
        return True
    export = find_export(model)
    if export.kind != "transforms":
        return export.kind == "bundler"
    try:
        return bool(read_transforms_json(export.files[0]).get("ply_file_path"))
    except FormatError:
        return False  # `read_cameras` reports the error.


def _from_export(
    model: Path, photo_set: PhotoSet, emit: Emit, should_stop: StopCheck
) -> tuple[list[GivenCamera], SparsePoints]:
    read = read_export(find_export(model), model, should_stop)
    parts: list[Part] = []
    names: list[str] = []
    all_matches: list[NameMatches] = []
    for label, makers in zip(read.labels, read.parts, strict=True):
        matches = _matched(list(makers), photo_set)
        names += makers
        all_matches.append(matches)
        parts.append(Part(label, cameras_of(makers, matches.found, photo_set.photos), read.points))
    for matches in all_matches:
        _require_unambiguous(matches, model)
    parts = [part for part in parts if part.cameras]
    if not parts:
        raise _none_matches(names, photo_set, model)
    whole, message = joined_parts(parts, model)
    if message:
        emit(Warned(message))
    return whole.cameras, whole.points if read.cloud is None else read_cloud(read.cloud, should_stop)


@dataclass(frozen=True)
class _ReadPlace:
    """The sub-models of a place, with the cameras of photos, and the names of their pictures with what they matched."""

    parts: list[Part]
    names: list[str]
    matches: list[NameMatches]
    problems: list[HeritageError]

    def fitting(self) -> int:
        """Return the number of photos that a camera fits by its size."""
        cameras = (camera for part in self.parts for camera in part.cameras)
        return len({camera.photo.name for camera in cameras if any(map(camera.fits, ORIENTATIONS))})

    def photos(self) -> int:
        """Return the number of photos with a camera."""
        return len({camera.photo.name for part in self.parts for camera in part.cameras})


def _from_models(
    model: Path, places: Sequence[ModelPlace], photo_set: PhotoSet, emit: Emit, should_stop: StopCheck
) -> tuple[list[GivenCamera], SparsePoints]:
    """Return the cameras and points of the place that fits the photos best."""
    read = [_read_place(place, model, photo_set, should_stop) for place in places]
    inside = [int(_is_inside(photo_set.folder, place.base)) for place in places]
    # The first of equals: `max` keeps it.
    best = max(range(len(read)), key=lambda index: (read[index].fitting(), inside[index], read[index].photos()))
    chosen = read[best]
    parts = [part for part in chosen.parts if part.cameras]
    if not parts and (problem := next((one for place in read for one in place.problems), None)) is not None:
        raise problem
    for matches in chosen.matches:
        _require_unambiguous(matches, model)
    if not parts:
        raise _none_matches(chosen.names, photo_set, model)
    for problem in chosen.problems:
        emit(Warned(f"A part of the model in {model} is not used. {problem}"))
    whole, message = joined_parts(parts, model)
    if message:
        emit(Warned(message))
    return whole.cameras, whole.points


def _read_place(place: ModelPlace, model: Path, photo_set: PhotoSet, should_stop: StopCheck) -> _ReadPlace:
    read = _ReadPlace([], [], [], [])
    for folder in place.parts:
        try:
            images, points = read_model(folder, should_stop)
        except (CameraError, FormatError) as problem:
            read.problems.append(problem)
            continue
        names = [image.name for image in images]
        matches = _matched(names, photo_set)
        read.names.extend(names)
        read.matches.append(matches)
        read.parts.append(Part(folder.relative_to(model).as_posix(), _given(images, matches, photo_set), points))
    return read


def _given(images: Sequence[ModelImage], matches: NameMatches, photo_set: PhotoSet) -> list[GivenCamera]:
    photos = {photo.name: photo for photo in photo_set.photos}
    by_name = {image.name: image for image in images}
    return [_given_camera(by_name[name], photos[photo]) for name, photo in matches.found.items()]


def _given_camera(image: ModelImage, photo: Photo) -> GivenCamera:
    lens = image.lens
    return GivenCamera(photo, image.name, image.viewmat, lambda *_: lens, (lens.width, lens.height), image.seen)


def _is_inside(folder: Path, base: Path) -> bool:
    try:
        return folder.resolve().is_relative_to(base.resolve())
    except OSError:
        return False


def _matched(names: Sequence[str], photo_set: PhotoSet) -> NameMatches:
    return match_names(names, [photo.name for photo in photo_set.photos])


def _require_unambiguous(matches: NameMatches, model: Path) -> None:
    if problem := matches.ambiguity():
        raise CameraError(
            f"The names of pictures in {model} do not say which photos they are: {problem}. Keep the folders that the "
            "pictures had when they were placed, or rename the photos."
        )


def _none_matches(names: Sequence[str], photo_set: PhotoSet, model: Path) -> CameraError:
    """Return the error for a model of which no picture is one of the photos."""
    if not names:
        return CameraError(f"{model} has no placed pictures. Choose another model, or let the cameras be estimated.")
    return CameraError(
        f"None of the pictures in {model} is among the photos: it has, for example, {min(names)}, the photo folder "
        f"{min(photo.name for photo in photo_set.photos)}. Choose the photo folder the model was made from."
    )


def _require_usable_cameras(cameras: list[Camera], model: Path) -> None:
    for camera in cameras:
        require_valid_lens(camera.lens)
        if problem := camera_problem(camera):
            raise CameraError(
                f"The camera of {camera.photo} in {model} cannot be used, because {problem}. Correct it, or let the "
                "cameras be estimated."
            )
