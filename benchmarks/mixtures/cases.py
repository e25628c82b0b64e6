"""One mixture: drawn, read by the product's own functions, and compared with its truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine.cameras import read_cameras
from engine.cameras.settings import CameraSettings
from engine.core.errors import HeritageError
from engine.core.events import Warned
from engine.core.words import split_texts
from engine.photos import load_pixels, read_photos
from engine.scene import Camera, CameraSet, PhotoSet

from .folders import Mixture, Shot, draw_folder
from .models import draw_model

RIGHT, REPORTED, WRONG = "right", "reported", "silently wrong"
_QUICK = CameraSettings(max_side=320, max_features=1000, first_octave=-1)
_MAX_ERROR = 12.0  # of 255 levels: losses of JPEG and HEIC; another photo or a wrong rotation has 25 and more
_WORDS = ("vase", "teapot", "bust", "drum", "globe", "violin", "chair", "mask")
_PHRASES = ("blue and white vase", "salt and pepper shaker", "vase with two handles")
_SEPARATORS = (", ", "; ", "/", "\n", " and ", " & ", ",", " und ", " + ", ". ")


@dataclass(frozen=True)
class Outcome:
    """What became of a case: one of `RIGHT`, `REPORTED` and `WRONG`, the kinds that it mixes, and sentences."""

    seed: int
    result: str
    kinds: frozenset[str]
    sentences: tuple[str, ...]


def run_case(seed: int, work: Path) -> Outcome:
    """Draw the case of `seed` into the empty folder `work`, read it, and compare it with its truth."""
    rng = np.random.default_rng(seed)
    mixture = draw_folder(rng, work / "photos")
    told: list[str] = []

    def emit(event: Any) -> None:
        if isinstance(event, Warned):
            told.append(event.message)

    faults = _faults_of_prompt(rng, mixture)
    try:
        photo_set = read_photos(mixture.folder, emit=emit)
    except HeritageError as error:
        return Outcome(seed, WRONG, frozenset(mixture.kinds), (f"no photo is read: {error}", *faults))
    faults += _faults_of_photos(mixture, photo_set)
    read = {photo.name for photo in photo_set.photos}
    used = [next((name for name in shot.names if name in read), shot.names[0]) for shot in mixture.shots]
    model, placed = draw_model(rng, mixture, used, work / "model")
    try:
        cameras = read_cameras(model, photo_set, _QUICK, folder=_made(work / "matches"), emit=emit)
    except HeritageError as error:
        told.append(str(error))
    else:
        missing = placed - {camera.photo for camera in cameras.cameras}
        faults += [f"{name} has no camera" for name in sorted(missing & read)]
        faults += _faults_of_cameras(mixture, used, cameras)
    result = WRONG if faults else REPORTED if told else RIGHT
    return Outcome(seed, result, frozenset(mixture.kinds), tuple(faults) or tuple(told))


def _made(folder: Path) -> Path:
    folder.mkdir()
    return folder


def _faults_of_prompt(rng: np.random.Generator, mixture: Mixture) -> list[str]:
    separator = str(rng.choice(_SEPARATORS))
    words = [str(word) for word in rng.choice(_WORDS, int(rng.integers(2, 5)), replace=False)]
    if separator in (", ", "; ", "\n") and rng.random() < 0.5:
        words[-1] = str(rng.choice(_PHRASES))
    mixture.kinds.add(f"prompt: {separator.strip() or 'new line'}")
    found = split_texts(separator.join(words))
    return [] if found == words else [f"the prompt {separator.join(words)!r} gives {found}"]


def _faults_of_photos(mixture: Mixture, photo_set: PhotoSet) -> list[str]:
    used = {photo.name: photo for photo in photo_set.photos}
    reasons = {photo.name: photo.reason for photo in photo_set.rejected}
    faults = []
    expected = {name for shot in mixture.shots for name in shot.names}
    faults += [f"{name} is used and is no photo of its own" for name in used if name not in expected]
    faults += [f"{name} is left out without a reason" for name in mixture.told if name not in {**used, **reasons}]
    for shot in mixture.shots:
        name = next((name for name in shot.names if name in used), None)
        if name is None:
            faults.append(f"{shot.names[0]} is not used: {reasons.get(shot.names[0], 'no reason')}")
            continue
        pixels = load_pixels(mixture.folder / name)
        photo = used[name]
        if pixels.shape != shot.pixels.shape or (photo.height, photo.width) != shot.pixels.shape[:2]:
            faults.append(f"{name} has the wrong size")
        elif (error := float(np.abs(pixels.astype(float) - shot.pixels).mean())) > _MAX_ERROR:
            faults.append(f"{name} is decoded wrongly, by {error:.0f} of 255 levels")
    return faults


def _faults_of_cameras(mixture: Mixture, used: list[str], cameras: CameraSet) -> list[str]:
    truth = dict(zip(used, mixture.shots, strict=True))
    faults = []
    for camera in cameras.cameras:
        if camera.photo not in truth:
            faults.append(f"{camera.photo} has a camera and is no shot of the model")
        elif (error := _error(camera, truth[camera.photo], cameras.original_from_world)) > 0.01:
            faults.append(f"the camera of {camera.photo} is wrong by {error:.2f}")
    return faults


def _error(camera: Camera, shot: Shot, original_from_world: NDArray[np.float64]) -> float:
    """Return the largest error of position (metres), axes and focal length (share) of a camera."""
    turn = original_from_world[:3, :3] / np.cbrt(np.linalg.det(original_from_world[:3, :3]))
    center = original_from_world[:3, :3] @ camera.center + original_from_world[:3, 3]
    true_rotation = shot.viewmat[:3, :3]
    focal = float(camera.params[0])
    return float(
        max(
            np.abs(center + true_rotation.T @ shot.viewmat[:3, 3]).max(),
            np.abs(camera.viewmat[:3, :3] @ turn.T - true_rotation).max(),
            abs(focal / shot.focal - 1.0),
        )
    )
