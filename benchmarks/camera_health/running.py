"""Runs the photo sets and keeps what was found, so that a stopped run continues."""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from engine.cameras import check_given_cameras, estimate_cameras, read_cameras
from engine.core.arrays import Float64
from engine.core.errors import HeritageError
from engine.core.events import Event, Warned
from engine.photos import read_photos
from engine.scene import CameraSet

from .cases import Kind, PhotoCase

_OUTCOME = "outcome.json"
_RIGHT = 0.03
"""Median error of the positions, in the radius of the true ones, up to which a model is right."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What came of one photo set.

    Attributes
    ----------
    name : str
    causes : tuple of str
        Causes that name the fault; empty for a sound set.
    choosing : bool
    kind : Kind
    is_real : bool
        Whether the photos are of a camera, not generated.
    n_photos, n_placed : int
    error : float or None
        Reprojection error in pixels.
    position_error : float or None
        Median error of the positions, in the radius of the true ones, or for a spoilt real set of those that its whole
        sound set has; None where these are unknown.
    colour, cause, sentence : str
        The finding; ``"refused"`` as colour where there was an error, whose sentence is then that of the error.
    """

    name: str
    causes: tuple[str, ...]
    choosing: bool
    kind: Kind
    is_real: bool
    n_photos: int
    n_placed: int
    error: float | None
    position_error: float | None
    colour: str
    cause: str
    sentence: str

    @property
    def is_right(self) -> bool:
        """Whether the positions are right, so that nothing had to be named."""
        return self.position_error is not None and self.position_error <= _RIGHT

    @property
    def verdict(self) -> str:
        """``green`` or ``false alarm`` of a sound set; ``named``, ``mended``, ``other cause`` or ``missed`` of another.

        Given cameras are not mended: they are named or not.
        """
        if not self.causes:
            return "green" if self.colour == "green" else "false alarm"
        if self.colour != "green" and self.cause in self.causes:
            return "named"
        if self.is_right and self.colour != "red" and self.kind != "swapped":
            return "mended"
        return "missed" if self.colour == "green" else "other cause"

    @property
    def is_as_it_should_be(self) -> bool:
        """Whether a sound set is green, or the fault of another was named or mended."""
        return self.verdict in ("green", "named", "mended")


def run_case(case: PhotoCase, folder: Path, say: Callable[[str], None]) -> Outcome:
    """Return the outcome of a photo set, from `folder` if an earlier run stored it there."""
    work = folder / _folder_name(case.name)
    stored = work / _OUTCOME
    if stored.is_file():
        values = json.loads(stored.read_text(encoding="utf-8"))
        return Outcome(**{**values, **_of_case(case)})
    shutil.rmtree(work / "photos", ignore_errors=True)
    model = case.write(work / "photos")
    n_files = len(list((work / "photos").iterdir()))
    warned: list[str] = []

    def emit(event: Event) -> None:
        if isinstance(event, Warned):
            warned.append(event.message)

    found: dict[str, Any] = {"n_placed": 0, "error": None, "position_error": None}
    try:
        photo_set = read_photos(work / "photos")
        if model is None:
            cameras = estimate_cameras(photo_set, work / "sfm", case.settings, emit=emit)
        else:
            cameras = check_given_cameras(read_cameras(model, photo_set), photo_set, emit=emit)
        health = cameras.health
        if case.kind == "sound" and case.is_real:
            _keep_positions(cameras, case, work)
        found.update(
            n_placed=len(cameras.cameras),
            error=cameras.reprojection_error if np.isfinite(cameras.reprojection_error) else None,
            position_error=_position_error(cameras, case.positions or _whole_set(case, folder)),
            colour="" if health is None else health.colour,
            cause="" if health is None else health.cause,
            sentence="" if health is None else health.sentence,
        )
    except HeritageError as error:
        found.update(colour="refused", cause=_cause_of(str(error)), sentence=str(error))
    outcome = Outcome(**_of_case(case), n_photos=n_files, **found)
    stored.write_text(json.dumps(dataclasses.asdict(outcome), indent=1), encoding="utf-8")
    say(f"{case.name}: {outcome.colour} {outcome.cause}")
    return outcome


def _of_case(case: PhotoCase) -> dict[str, Any]:
    names = ("name", "causes", "choosing", "kind", "is_real")
    return {name: getattr(case, name) for name in names}


def _cause_of(message: str) -> str:
    """Return the cause that an error names; empty when it names none."""
    words = {"mirror": "mirrored", "panorama": "panorama", "from one place": "one_place"}
    return next((cause for word, cause in words.items() if word in message), "")


def _folder_name(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", name.lower())


def _keep_positions(cameras: CameraSet, case: PhotoCase, work: Path) -> None:
    """Store the positions of a whole real set under the names that `sources` gives its photos."""
    names = {path.name: index for index, path in enumerate(sorted((work / "photos").iterdir()))}
    found = {f"{case.source}_{names[one.photo]:02d}.jpg": one.center.tolist() for one in cameras.cameras}
    (work / "positions.json").write_text(json.dumps(found), encoding="utf-8")


def _whole_set(case: PhotoCase, folder: Path) -> dict[str, Float64]:
    """Return the positions that a real set has when all its photos are used as they are, if they were found before."""
    stored = folder / _folder_name(f"sound: {case.source}") / "positions.json"
    if not (case.is_real and stored.is_file()) or case.kind == "sound":
        return {}
    return {photo: np.array(at) for photo, at in json.loads(stored.read_text(encoding="utf-8")).items()}


def _position_error(cameras: CameraSet, positions: dict[str, Float64]) -> float | None:
    known = [camera for camera in cameras.cameras if camera.photo in positions]
    if len(known) < 3:
        return None
    found = np.array([camera.center for camera in known])
    true = np.array([positions[camera.photo] for camera in known])
    left = distances_when_aligned(found, true)
    return float(np.median(left) / np.median(np.linalg.norm(true - true.mean(0), axis=1)))


def distances_when_aligned(found: Float64, true: Float64) -> Float64:
    """Return how far positions [N, 3] lie from the true ones [N, 3] after the best similarity, shape [N]."""
    found, true = found - found.mean(0), true - true.mean(0)
    u, s, vt = np.linalg.svd(true.T @ found)
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    scale = (s * np.diag(sign)).sum() / np.square(found).sum()
    aligned = scale * found @ (u @ sign @ vt).T
    return np.asarray(np.linalg.norm(aligned - true, axis=1))
