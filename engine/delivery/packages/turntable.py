"""Pictures of a scene or an object from all sides that photos saw, as a sheet and as a film."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ...cameras import training_pinhole
from ...core.arrays import Pixels
from ...core.errors import Cancelled, DiskError, EnvironmentProblem, ProjectError
from ...core.events import StopCheck, never_stop
from ...core.files import delete_derived, write_problem
from ...core.system import replace_file
from ...pictures import Scene, render_view, write_png
from ...rasterizer.settings import Backend
from ...scene import Camera, Gaussians, PinholeCamera
from ..report import best_seen_from, orbit_cameras, picture_sheet, render_alone

N_PICTURES = 72
"""Pictures of a turn: one each five degrees of a full one."""
SHEET = "contact_sheet.png"
FILMS = {"turntable.webm": "VP80", "turntable.mp4": "mp4v"}
"""Films by name, with their codec. Browsers play VP8, presentation programs MPEG-4. OpenCV has no encoder for H.264,
and that for VP9 takes four times as long as VP8 for the same size and likeness."""
_OBJECT_SIDE = 512
_SCENE_SIDE = 640
"""Longest side of the pictures, pixels."""
_FRAMES_PER_SECOND = 24.0
_SHEET_COLUMNS, _SHEET_ROWS = 4, 3


@dataclass(frozen=True)
class Turn:
    """Pictures in the order in which they are shown.

    Attributes
    ----------
    cameras : list of PinholeCamera
    pictures : list of arrays of shape [H, W, 3], uint8
        All of one size.
    is_closed : bool
        Whether the last picture is followed by the first: photos surround the object.
    degrees : float
        Angle about the vertical axis that the cameras span.
    """

    cameras: list[PinholeCamera]
    pictures: list[Pixels]
    is_closed: bool
    degrees: float


def turn_of_object(
    whole: Gaussians,
    members: NDArray[np.bool_],
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    *,
    backend: Backend = "cpu",
    should_stop: StopCheck = never_stop,
) -> Turn:
    """Return pictures around an object, on paper white, from the sides that photos saw.

    Parameters
    ----------
    whole : Gaussians
        The scene.
    members : bool array of shape [N]
        The object's Gaussians in the scene.
    gaussians : Gaussians
        The object as it is exported, at least one Gaussian.
    cameras : sequence of Camera
        Of the photos.
    backend : {"cpu", "gpu", "reference"}
    should_stop : callable
        See `engine.core.events`.
    """
    (seen_from,) = best_seen_from(Scene(whole, backend=backend), [members], cameras)
    sides = orbit_cameras(gaussians.means, seen_from, count=N_PICTURES, side=_OBJECT_SIDE)
    alone, pictures = Scene(gaussians, backend=backend), []
    for side in sides:
        _stop_if(should_stop)
        pictures.append(render_alone(alone, side))
    steps = [_degrees_between(a, b) for a, b in zip(sides, sides[1:], strict=False)]
    # A full turn is divided evenly, so that the step from the last picture to the first is as large as the others.
    closed = _degrees_between(sides[-1], sides[0]) < 1.5 * steps[0]
    return Turn(sides, pictures, closed, 360.0 if closed else sum(steps))


def turn_of_scene(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    *,
    backend: Backend = "cpu",
    should_stop: StopCheck = never_stop,
) -> Turn:
    """Return pictures of a scene from the places of its photos, in the order of their names.

    A room has no outside that a turntable could show. All pictures have the size of the first camera's.

    Raises
    ------
    ProjectError
        When the scene has no cameras.
    """
    if not cameras:
        raise ProjectError("The scene has no cameras, so no pictures of it can be made. Reconstruct it again.")
    chosen = [cameras[i] for i in np.unique(np.linspace(0, len(cameras) - 1, N_PICTURES).astype(int))]
    first = training_pinhole(chosen[0], max_side=_SCENE_SIDE)
    sides = [training_pinhole(camera, max_side=_SCENE_SIDE) for camera in chosen]
    pictures = []
    for side in sides:
        _stop_if(should_stop)
        picture = render_view(gaussians, side, backend=backend)
        if picture.shape[:2] != (first.height, first.width):
            picture = _fitted(picture, first.width, first.height)
        pictures.append(picture)
    return Turn(sides, pictures, False, 0.0)


def _fitted(picture: Pixels, width: int, height: int) -> Pixels:
    """Return a picture, made smaller, in the middle of a black one of another shape."""
    scale = min(width / picture.shape[1], height / picture.shape[0])
    size = max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    left, top = (width - size[0]) // 2, (height - size[1]) // 2
    framed = np.zeros((height, width, 3), np.uint8)
    framed[top : top + size[1], left : left + size[0]] = small
    return framed


def _stop_if(should_stop: StopCheck) -> None:
    if should_stop():
        raise Cancelled("Stopped. Nothing was written.")


def _degrees_between(a: PinholeCamera, b: PinholeCamera) -> float:
    """Return the angle about the vertical axis between the directions in which two cameras look."""
    first, second = (np.arctan2(*camera.viewmat[2, 1::-1]) for camera in (a, b))
    return float(np.degrees(abs(np.angle(np.exp(1j * (first - second))))))


def write_sheet(path: Path, title: str, pictures: Sequence[Pixels]) -> None:
    """Write twelve of the pictures, evenly spaced, with the title, as one PNG.

    Raises
    ------
    DiskError
        When it cannot be written.
    """
    count = min(len(pictures), _SHEET_COLUMNS * _SHEET_ROWS)
    shown = [pictures[i] for i in np.linspace(0, len(pictures), count, endpoint=False).astype(int)]
    rows = [shown[start : start + _SHEET_COLUMNS] for start in range(0, count, _SHEET_COLUMNS)]
    sheet = picture_sheet([(title if i == 0 else "", row) for i, row in enumerate(rows)])
    if sheet is not None:
        write_png(path, sheet, description=title)


def write_films(folder: Path, turn: Turn) -> list[Path]:
    """Write the pictures as films: ``turntable.webm`` for browsers, ``turntable.mp4`` for other programs.

    A turn that is not closed goes there and back, so that the film can be repeated.

    Raises
    ------
    EnvironmentProblem
        When OpenCV was built without a codec.
    DiskError
        When the film cannot be written.
    """
    there = list(turn.pictures)
    frames = there if turn.is_closed else there + there[-2:0:-1]
    paths = [folder / name for name in FILMS]
    for path, codec in zip(paths, FILMS.values(), strict=True):
        _write_film(path, codec, frames)
    return paths


def _write_film(path: Path, codec: str, frames: Sequence[Pixels]) -> None:
    height, width = frames[0].shape[:2]
    # Both halve the resolution of colours, so they take even sizes.
    height, width = height - height % 2, width - width % 2
    temporary = path.with_name(f".writing-{path.name}")
    try:
        with _quiet_codec():
            film = cv2.VideoWriter(
                str(temporary), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*codec), _FRAMES_PER_SECOND, (width, height)
            )
        if not film.isOpened():
            raise EnvironmentProblem(
                f"OpenCV of this environment cannot write {path.name}, so no film was made. Set up the engine again."
            )
        for frame in frames:
            film.write(np.ascontiguousarray(frame[:height, :width, ::-1]))
        film.release()
        if not temporary.is_file() or temporary.stat().st_size == 0:
            raise DiskError(f"Could not write {path}. Free some space or choose another folder.")
        replace_file(temporary, path)
    except OSError as error:
        raise write_problem(path, error) from error
    finally:
        delete_derived(path.parent, temporary.name)


@contextmanager
def _quiet_codec() -> Iterator[None]:
    """Discard what FFMPEG writes to file descriptor 2: WebM has no tag for VP8, which is written all the same."""
    stderr = os.dup(2)
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
