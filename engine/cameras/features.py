"""SIFT features and verified matches of a photo set in a COLMAP database that a killed run leaves usable."""

from __future__ import annotations

import functools
import json
import os
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from ..errors import CameraError
from ..events import StopCheck
from ..project_folder import stage_key, write_json
from ..scene import Camera, Photo, PhotoSet
from ..settings import to_dict
from .colmap_calls import threads_for_colmap, wait_for
from .pairs import Pair, all_pairs, largest_descriptors, promising_pairs
from .settings import CameraSettings
from .working_copies import WorkingCopy, plan_copies, write_copies, write_whole_masks

__all__ = ["Workshop", "match_features"]

_Report = Callable[[float, str], None]

# Shares of the time of this module's work, measured on 32 photos.
_COPIED, _DETECTED, _CHOSEN = 0.03, 0.58, 0.64

_PHOTOS_AT_ONCE = 4
_PAIRS_AT_ONCE = 24
_DESCRIPTOR = 128
"""Numbers of a SIFT descriptor; a photo without features has none to count."""


class Workshop:
    """The folder a reconstruction is made in: copies of the photos, COLMAP's database, its models.

    Parameters
    ----------
    folder : Path
        Emptied when what lies there was made from other photos or with other settings; else continued.
    photo_set : PhotoSet
    settings : CameraSettings
    lenses : mapping of photo name to Camera, optional
        Known lenses. By default photos of equal size and EXIF focal length share one that is yet to be found.
    """

    def __init__(
        self,
        folder: Path,
        photo_set: PhotoSet,
        settings: CameraSettings,
        lenses: Mapping[str, Camera] | None = None,
    ) -> None:
        self.images = folder / "images"
        self.masks = folder / "masks"
        self.database = folder / "database.db"
        self.sparse = folder / "sparse"
        self.pairs = folder / "pairs.txt"
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
        made_from = stage_key(
            [[copy.name, *copy.photo.hashes[1:], copy.width, copy.height] for copy in self.copies],
            [self._lens_of(copy.photo) for copy in self.copies],
            to_dict(self.settings),
            pycolmap.__version__,
        )
        note = self._folder / "made_from.json"
        try:
            same = json.loads(note.read_text(encoding="utf-8")) == made_from
        except (OSError, ValueError):
            same = False
        if not same:
            self.clear()
            write_json(note, made_from)

    def clear(self) -> None:
        """Remove what this class keeps in the folder, and nothing else."""
        (self._folder / "made_from.json").unlink(missing_ok=True)
        for path in (self.images, self.masks, self.sparse):
            shutil.rmtree(path, ignore_errors=True)
        for path in self._folder.glob("database.db*"):
            path.unlink()
        self.pairs.unlink(missing_ok=True)

    def copy_of(self, name: str) -> WorkingCopy:
        """Return the copy that COLMAP knows under `name`."""
        return self.copies[int(Path(name).stem)]


def match_features(workshop: Workshop, *, report: _Report, should_stop: StopCheck) -> None:
    """Fill the workshop's database with features and verified matches; what lies there already is kept.

    Parameters
    ----------
    workshop : Workshop
    report : callable
        Gets the fraction done of this function's work and a message.
    should_stop : StopCheck
        Asked five times a second.

    Raises
    ------
    CameraError
        When there is nothing to match in the photos, or COLMAP fails.
    Cancelled, DiskError, PhotoError
        See `write_copies` and `wait_for`.
    """
    write_copies(
        workshop.copies,
        workshop.photo_set.folder,
        workshop.images,
        workshop.masks,
        report=lambda done: report(_COPIED * done, "copying the photos"),
        should_stop=should_stop,
    )
    if not workshop.database.is_file():
        _create_database(workshop)
    _detect(workshop, report, should_stop)
    pairs = _choose_pairs(workshop, report, should_stop)
    _match(workshop, pairs, report, should_stop)


def _create_database(workshop: Workshop) -> None:
    """Enter photos and lenses under a temporary name, so that a database is either whole or not there."""
    unfinished = workshop.database.with_name("database.db.new")
    for leftover in workshop.database.parent.glob(unfinished.name + "*"):
        leftover.unlink()
    pycolmap.Database.open(unfinished).close()
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = workshop.settings.model
    names = [copy.name for copy in workshop.copies]
    # In the order of the photos and before anything runs on several threads: the ids must not depend on chance.
    pycolmap.import_images(unfinished, workshop.images, pycolmap.CameraMode.PER_FOLDER, names, reader)
    first_of_group: dict[str, WorkingCopy] = {}
    for copy in workshop.copies:
        first_of_group.setdefault(copy.name.split("/")[0], copy)
    with pycolmap.Database.open(unfinished) as database:
        for image in database.read_all_images():
            first = first_of_group.pop(image.name.split("/")[0], None)
            if first is not None:
                database.update_camera(_lens(database.read_camera(image.camera_id), first, workshop))
    os.replace(unfinished, workshop.database)


def _lens(guess: pycolmap.Camera, copy: WorkingCopy, workshop: Workshop) -> pycolmap.Camera:
    """Return the lens of a group for the database: the known one, or COLMAP's `guess` with the focal length of EXIF."""
    known = workshop.lenses.get(copy.photo.name)
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
    return guess


def _detect(workshop: Workshop, report: _Report, should_stop: StopCheck) -> None:
    settings = workshop.settings
    options = pycolmap.FeatureExtractionOptions()
    options.num_threads = threads_for_colmap(settings.threads)
    options.use_gpu = False
    options.sift.max_num_features = settings.max_features
    options.sift.first_octave = settings.first_octave
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = settings.model
    if workshop.masks.is_dir():
        # COLMAP finds nothing in a photo whose mask is missing.
        write_whole_masks(workshop.copies, workshop.masks)
        reader.mask_path = workshop.masks
    names = [copy.name for copy in workshop.copies]

    with pycolmap.Database.open(workshop.database) as database:
        detected = {image.name for image in database.read_all_images() if database.exists_descriptors(image.image_id)}
    # In batches, for progress: a look into the database while COLMAP writes it would disturb its locks.
    missing = [name for name in names if name not in detected]
    for start in range(0, len(missing), _PHOTOS_AT_ONCE):
        batch = missing[start : start + _PHOTOS_AT_ONCE]
        done = len(names) - len(missing) + start
        report(_COPIED + (_DETECTED - _COPIED) * done / len(names), f"features in {done} of {len(names)} photos")
        wait_for(
            "looking for features in the photos",
            functools.partial(_extract, workshop, batch, reader, options),
            report=_nothing,
            should_stop=should_stop,
        )


def _extract(
    workshop: Workshop,
    names: list[str],
    reader: pycolmap.ImageReaderOptions,
    options: pycolmap.FeatureExtractionOptions,
    token: pycolmap.CancellationToken,
) -> None:
    pycolmap.extract_features(
        workshop.database,
        workshop.images,
        names,
        pycolmap.CameraMode.PER_FOLDER,
        reader,
        options,
        pycolmap.Device.cpu,
        token,
    )


def _nothing() -> None:
    """Report nothing within a batch."""


def _choose_pairs(workshop: Workshop, report: _Report, should_stop: StopCheck) -> list[Pair]:
    """Return pairs of indices into ``workshop.copies``."""
    count = len(workshop.copies)
    if count <= workshop.settings.exhaustive_up_to:
        return all_pairs(count)
    descriptors = []
    with pycolmap.Database.open(workshop.database) as database:
        ids = {image.name: image.image_id for image in database.read_all_images()}
        for copy in workshop.copies:
            keypoints = database.read_keypoints(ids[copy.name])
            # Columns: x, y and the feature's affine shape [[a11, a12], [a21, a22]].
            scales = np.hypot(keypoints[:, 2], keypoints[:, 4]) if keypoints.shape[1] >= 6 else keypoints[:, 2]
            data = np.asarray(database.read_descriptors(ids[copy.name]).data)
            descriptors.append(largest_descriptors(scales, data.reshape(-1, _DESCRIPTOR), photos=count))
    return promising_pairs(
        descriptors,
        neighbours=workshop.settings.neighbours,
        report=lambda done: report(_DETECTED + (_CHOSEN - _DETECTED) * done, "choosing pairs of photos"),
        should_stop=should_stop,
    )


def _match(workshop: Workshop, pairs: list[Pair], report: _Report, should_stop: StopCheck) -> None:
    settings = workshop.settings
    names = [copy.name for copy in workshop.copies]
    matching = pycolmap.FeatureMatchingOptions()
    matching.num_threads = threads_for_colmap(settings.threads)
    matching.use_gpu = False
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = settings.seed
    pairing = pycolmap.ImportedPairingOptions()
    pairing.match_list_path = workshop.pairs
    for start in range(0, len(pairs), _PAIRS_AT_ONCE):
        batch = pairs[start : start + _PAIRS_AT_ONCE]
        report(_CHOSEN + (1.0 - _CHOSEN) * start / len(pairs), f"{start} of {len(pairs)} pairs matched")
        workshop.pairs.write_text("".join(f"{names[i]} {names[j]}\n" for i, j in batch), encoding="ascii")
        pycolmap.set_random_seed(settings.seed)
        # Pairs that a killed run matched already are passed over by COLMAP.
        wait_for(
            "matching the photos",
            lambda token: pycolmap.match_image_pairs(
                workshop.database, matching, pairing, verification, pycolmap.Device.cpu, token
            ),
            report=_nothing,
            should_stop=should_stop,
        )
    with pycolmap.Database.open(workshop.database) as database:
        if database.num_inlier_matches() > 0:
            return
        few = database.num_keypoints() < 100 * len(names)
    if few:
        raise CameraError(
            "No camera poses were found: the photos show too little texture or are blurred. Photograph the object with "
            "its surroundings, in focus."
        )
    raise CameraError(
        "No camera poses were found: no two photos show the same place. Take photos that overlap by two thirds, all "
        "around the object."
    )
