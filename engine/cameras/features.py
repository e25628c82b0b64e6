"""SIFT features and verified matches of a photo set, in a COLMAP database from which a stopped run resumes."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from copy import copy as shallow_copy
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.errors import CameraError, DiskError, FormatError
from ..core.events import Emit, Progress, StopCheck
from ..core.files import delete_derived, read_json, write_json
from ..core.settings import to_dict
from ..core.system import free_memory, native_path, replace_file
from ..project.folder import stage_key
from ..scene import Camera, Photo, PhotoSet, is_fisheye
from .colmap import pycolmap
from .colmap_calls import create_database, is_whole_database, opened_database, require_free_space, translated, wait_for
from .feature_scales import feature_sizes
from .matching import copy_for_mapping, match_pairs
from .pairs import Pair, all_pairs, largest_descriptors, largest_rows, promising_pairs
from .processes import cores_for, detecting_cores
from .settings import CameraSettings
from .working_copies import WorkingCopy, plan_copies, write_copies, write_default_masks

_Report = Callable[[float, str], None]

# Fractions of this module's run time after copying, detection and pair selection, measured on 32 photos.
_COPIED, _DETECTED, _PAIRS_SELECTED = 0.03, 0.58, 0.64

_FISHEYE_FOCAL = 0.4
"""First guess of the focal length of a fisheye lens, in longest sides of the photo, of which it shows 180 degrees along
the diagonal."""
_ROUNDS_PER_BATCH = 2
"""Photos of a batch for each core that detects."""
_DESCRIPTOR_DIM = 128
"""Length of a SIFT descriptor, needed to shape the empty array of a photo without features."""
_DATABASE_BESIDE, _SPARSE_BESIDE = "database.db.beside", "sparse_beside"
"""Names of the database and the models of `SfmWorkspace.mapped_beside`."""


def _for_colmap(folder: Path) -> Path:
    """Make a folder, and return it under a name that COLMAP can read."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return native_path(folder)
    except OSError as error:
        raise DiskError(f"{error.strerror or error}. Choose another folder for the project.") from error


class SfmWorkspace:
    """Work folder of structure from motion: copies of the photos, COLMAP's database and its models.

    Parameters
    ----------
    folder : Path
        The work resumes in this folder, which is emptied first when it belongs to other photos or settings.
    lenses : mapping of photo name to Camera, optional
        Known lenses. By default, photos of equal size and EXIF focal length share a lens, which is estimated.
    """

    def __init__(
        self,
        folder: Path,
        photo_set: PhotoSet,
        settings: CameraSettings,
        lenses: Mapping[str, Camera] | None = None,
    ) -> None:
        folder = _for_colmap(folder)
        self.images = folder / "images"
        self.masks = folder / "masks"
        self.database = folder / "database.db"
        self.sparse = folder / "sparse"
        self.photo_set = photo_set
        self.settings = settings
        self.lenses = lenses or {}
        self.copies = plan_copies(photo_set, settings.max_side, self._lens_of)
        self._folder = folder
        self._prepare()

    def _lens_of(self, photo: Photo) -> tuple[Any, ...]:
        known = self.lenses.get(photo.name)
        if known is not None:
            return photo.width, photo.height, known.model, known.params
        return photo.width, photo.height, None if photo.focal_px is None else round(photo.focal_px, 1)

    def _prepare(self) -> None:
        key = stage_key(
            [[copy.name, *copy.photo.hashes[1:], copy.width, copy.height] for copy in self.copies],
            [self._lens_of(copy.photo) for copy in self.copies],
            to_dict(self.settings),
            pycolmap.__version__,
        )
        key_file = self._folder / "made_from.json"
        try:
            same = read_json(key_file, str, advice="The work starts again.") == key
        except FormatError:
            same = False
        if not same or not is_whole_database(self.database):
            self.clear()
            write_json(key_file, key)
        self.delete_beside()
        for killed in self._folder.glob("trial-*"):
            delete_derived(self._folder, killed.name)

    def clear(self) -> None:
        """Remove the files of this class, and no other files, from the folder."""
        names = ["made_from.json", self.images.name, self.masks.name, "sparse", _SPARSE_BESIDE, "pairs.txt", "shares"]
        found = (path.name for pattern in ("database.db*", "trial-*") for path in self._folder.glob(pattern))
        for name in (*names, *found):
            delete_derived(self._folder, name)

    def delete_beside(self) -> None:
        """Delete the database and the models of `mapped_beside`, where there are any."""
        for name in (_SPARSE_BESIDE, *(path.name for path in self._folder.glob(f"{_DATABASE_BESIDE}*"))):
            delete_derived(self._folder, name)

    def mapped_beside(self) -> SfmWorkspace:
        """Return this workspace with a database and models of its own, in which photos get other lenses meanwhile."""
        beside = shallow_copy(self)
        beside.database, beside.sparse = self._folder / _DATABASE_BESIDE, self._folder / _SPARSE_BESIDE
        copy_for_mapping(self.database, beside.database)
        return beside

    def copy_of(self, name: str) -> WorkingCopy:
        """Return the copy that has this `name` in COLMAP's database."""
        return self.copies[int(Path(name).stem)]


def match_features(workspace: SfmWorkspace, *, report: _Report, should_stop: StopCheck) -> None:
    """Add features and verified matches to the workspace's database, except those it already has.

    Parameters
    ----------
    report : callable
        Receives the completed fraction of this function's work and a message.
    should_stop : StopCheck
        Called five times a second.

    Raises
    ------
    CameraError
        When no two photos could be matched, or COLMAP fails.
    Cancelled, DiskError, PhotoError
        See `write_copies` and `wait_for`.
    """
    write_copies(
        workspace.copies,
        workspace.photo_set.folder,
        workspace.images,
        workspace.masks,
        report=lambda done: report(_COPIED * done, "copying the photos"),
        should_stop=should_stop,
    )
    if not workspace.database.is_file():
        _create_database(workspace)
    _detect(workspace, report, should_stop)
    pairs = _select_pairs(workspace, report, should_stop)
    _match(workspace, pairs, report, should_stop)


def match_posed_photos(
    cameras: Sequence[Camera],
    photo_set: PhotoSet,
    settings: CameraSettings,
    folder: Path,
    *,
    emit: Emit,
    should_stop: StopCheck,
) -> SfmWorkspace:
    """Match the photos that have a camera, each with the lens of its camera, and return the workspace in `folder`.

    Emits `Progress` of the stage. See `match_features` for errors.
    """
    by_photo = {camera.photo: camera for camera in cameras}
    photos = tuple(photo for photo in photo_set.photos if photo.name in by_photo)
    workspace = SfmWorkspace(folder, PhotoSet(photo_set.folder, photos, ()), settings, by_photo)
    match_features(
        workspace,
        report=lambda done, message: emit(Progress("cameras", 0.9 * done, None, message)),
        should_stop=should_stop,
    )
    return workspace


def _create_database(workspace: SfmWorkspace) -> None:
    """Write photos and lenses to a database, which is renamed at the end so that it is complete or missing."""
    unfinished = workspace.database.with_name("database.db.new")
    create_database(unfinished)
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = workspace.settings.model
    if is_fisheye(workspace.settings.model):
        reader.default_focal_length_factor = _FISHEYE_FOCAL
    names = [copy.name for copy in workspace.copies]
    # In the order of the photos and on one thread, so that the ids do not depend on thread timing.
    with translated("listing the photos for COLMAP"):
        pycolmap.import_images(unfinished, workspace.images, pycolmap.CameraMode.PER_FOLDER, names, reader)
    first_of_group: dict[str, WorkingCopy] = {}
    for copy in workspace.copies:
        first_of_group.setdefault(copy.name.split("/")[0], copy)
    with opened_database(unfinished) as database:
        for image in database.read_all_images():
            first = first_of_group.pop(image.name.split("/")[0], None)
            if first is not None:
                database.update_camera(_lens(database.read_camera(image.camera_id), first, workspace))
    replace_file(unfinished, workspace.database)


def _lens(guess: pycolmap.Camera, copy: WorkingCopy, workspace: SfmWorkspace) -> pycolmap.Camera:
    """Return the lens of a group for the database: a known one, or COLMAP's `guess` with the focal length from EXIF."""
    known = workspace.lenses.get(copy.photo.name)
    if known is not None:
        lens = pycolmap.Camera(model=known.model, width=known.width, height=known.height, params=list(known.params))
        lens.rescale(copy.width, copy.height)
        lens.camera_id = guess.camera_id
        lens.has_prior_focal_length = True
        return lens
    if copy.focal_px is not None:
        params = np.array(guess.params)
        params[guess.focal_length_idxs()] = copy.focal_px
        guess.params = params
        guess.has_prior_focal_length = True
    elif is_fisheye(workspace.settings.model):
        # Two photos are then compared by the rays of this lens: in pixels, those of a fisheye lens do not match.
        guess.has_prior_focal_length = True
    return guess


def _detect(workspace: SfmWorkspace, report: _Report, should_stop: StopCheck) -> None:
    settings = workspace.settings
    options = pycolmap.FeatureExtractionOptions()
    largest = max(copy.width * copy.height for copy in workspace.copies)
    cores = detecting_cores(cores_for(settings.threads), largest, free=free_memory())
    options.num_threads = cores
    options.use_gpu = False
    options.sift.max_num_features = settings.max_features
    options.sift.first_octave = settings.first_octave
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = settings.model
    if workspace.masks.is_dir():
        # COLMAP detects no features in a photo whose mask is missing.
        write_default_masks(workspace.copies, workspace.masks)
        reader.mask_path = workspace.masks
    names = [copy.name for copy in workspace.copies]

    with opened_database(workspace.database) as database:
        detected = {image.name for image in database.read_all_images() if database.exists_descriptors(image.image_id)}
    # In batches, to report progress: reading the database while COLMAP writes to it would conflict with its locks.
    missing = [name for name in names if name not in detected]
    for start in range(0, len(missing), cores * _ROUNDS_PER_BATCH):
        require_free_space(workspace.database.parent)
        batch = missing[start : start + cores * _ROUNDS_PER_BATCH]
        done = len(names) - len(missing) + start
        report(_COPIED + (_DETECTED - _COPIED) * done / len(names), f"features in {done} of {len(names)} photos")
        wait_for(
            "detecting features in the photos",
            functools.partial(
                pycolmap.extract_features,
                workspace.database,
                workspace.images,
                batch,
                pycolmap.CameraMode.PER_FOLDER,
                reader,
                options,
                pycolmap.Device.cpu,
            ),
            should_stop=should_stop,
        )


class LargestFeatures(NamedTuple):
    """Descriptors [K, 128], as `largest_descriptors` returns them, and positions [K, 2] in pixels of the copy."""

    descriptors: NDArray[np.float32]
    positions: NDArray[np.float32]


def largest_features(database: Path, names: Sequence[str]) -> list[LargestFeatures]:
    """Return the largest features of each copy."""
    found = []
    with opened_database(database) as opened:
        ids = {image.name: image.image_id for image in opened.read_all_images()}
        for name in names:
            keypoints = opened.read_keypoints(ids[name])
            scales = feature_sizes(keypoints)
            data = np.asarray(opened.read_descriptors(ids[name]).data)
            descriptors = largest_descriptors(scales, data.reshape(-1, _DESCRIPTOR_DIM), photos=len(names))
            positions = np.asarray(keypoints)[largest_rows(scales, photos=len(names)), :2]
            found.append(LargestFeatures(descriptors, positions))
    return found


def _select_pairs(workspace: SfmWorkspace, report: _Report, should_stop: StopCheck) -> list[Pair]:
    """Return pairs of indices into ``workspace.copies``."""
    count = len(workspace.copies)
    if count <= workspace.settings.exhaustive_up_to:
        return all_pairs(count)
    features = largest_features(workspace.database, [copy.name for copy in workspace.copies])
    return promising_pairs(
        [one.descriptors for one in features],
        neighbours=workspace.settings.neighbours,
        seed=workspace.settings.seed,
        report=lambda done: report(_DETECTED + (_PAIRS_SELECTED - _DETECTED) * done, "selecting pairs of photos"),
        should_stop=should_stop,
    )


def _match(workspace: SfmWorkspace, pairs: list[Pair], report: _Report, should_stop: StopCheck) -> None:
    names = [copy.name for copy in workspace.copies]

    def matched(done: float) -> None:
        report(
            _PAIRS_SELECTED + (1.0 - _PAIRS_SELECTED) * done, f"{done * len(pairs):.0f} of {len(pairs)} pairs matched"
        )

    named = [(names[i], names[j]) for i, j in pairs]
    match_pairs(workspace.database, named, workspace.settings, report=matched, should_stop=should_stop)
    with opened_database(workspace.database) as database:
        if database.num_inlier_matches() > 0:
            return
        has_few_features = database.num_keypoints() < 100 * len(names)
    if has_few_features:
        raise CameraError(
            "No camera poses were found: the photos show too little texture or are blurred. Photograph the object with "
            "its surroundings, in focus."
        )
    raise CameraError(
        "No camera poses were found: no two photos show the same place. Take photos that overlap by two thirds, all "
        "around the object."
    )
