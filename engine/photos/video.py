"""A video as photos: the sharpest frame of each stretch of equal camera motion, written as JPEG files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import Cancelled, FormatError, PhotoError
from ..core.events import Emit, Progress, StopCheck
from ..core.files import delete_derived, file_sha256, path_within, read_json, write_file, write_json
from ..core.system import variable_for_libraries
from .kinds import VIDEO, kind_of_file
from .settings import VIDEO_SUFFIXES, VideoSettings

if TYPE_CHECKING:
    from cv2 import VideoCapture

STAGE = "frames"
_SCHEMA = {"made_from": str, "settings": dict, "files": [str], "complete": bool}
_FLOW_SIDE = 160  # motion is a share of the width, and a coarse picture shows it
_SHARPNESS_SIDE = 640  # as photos are trained, so blur below a pixel of it does not matter
_QUALITY = 95
_OPTIONS_VARIABLE = "OPENCV_FFMPEG_CAPTURE_OPTIONS"
_OPTIONS = "format_whitelist;mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpeg,asf|protocol_whitelist;file"
_SHARE_OF_LOOKING = 0.7
"""Share of the time that the first pass takes, for the progress."""


@dataclass(frozen=True)
class _Look:
    """A frame that was looked at: its number, its sharpness, and the motion since the one before, in widths."""

    number: int
    sharpness: float
    motion: float


def is_video(path: Path) -> bool:
    """Return whether `path` is a file that is a video by its content, or by its name where its content is unknown."""
    kind = kind_of_file(path)
    return kind == VIDEO or (kind is None and path.suffix.lower() in VIDEO_SUFFIXES and path.is_file())


def extract_frames(
    video: Path, folder: Path, settings: VideoSettings, *, emit: Emit, should_stop: StopCheck, prefix: str = "frame"
) -> list[Path]:
    """Write the best frames of a video into `folder`, or return the frames of an earlier call.

    Parameters
    ----------
    video : Path
        Any file that OpenCV's FFmpeg reads. Its rotation is applied.
    folder : Path
        What an earlier call with this `prefix` wrote there is replaced; other files stay.
    emit, should_stop
        See `engine.core.events`.
    prefix : str
        First part of the names of the files, before the number of the frame.

    Returns
    -------
    list of Path
        JPEG files in the order of the video.

    Raises
    ------
    PhotoError
        When the video cannot be read, is too short, or a photo of the same name is there already.
    Cancelled
        When it was stopped; the next call begins again.

    Notes
    -----
    The motion between two frames is the mean length of the optical flow (Kroeger et al. 2016) divided by the width. The
    video is cut into stretches of equal motion, so that a camera that rests gives few photos and one that turns gives
    many. Of each stretch the frame with the largest variance of the Laplacian is taken.
    """
    if not video.is_file():
        raise PhotoError(f"There is no video {video}.")
    key = {"made_from": file_sha256(video), "settings": asdict(settings)}
    record = path_within(folder, f"{prefix}.frames.json")
    known = _read(record, prefix)
    files = [] if known is None else [path_within(folder, name) for name in known["files"]]
    is_same = known is not None and known["complete"] and key == {name: known[name] for name in key}
    if is_same and all(file.is_file() for file in files):
        return files
    for file in files:
        delete_derived(folder, file.name)
    folder.mkdir(parents=True, exist_ok=True)
    looks = _look_at(video, settings, emit, should_stop)
    if len(looks) < settings.min_frames:
        raise PhotoError(
            f"{video.name} has {len(looks)} usable frames, and {settings.min_frames} are needed. Film longer, walking "
            "around the object."
        )
    chosen = _chosen(looks, settings)
    files = [path_within(folder, f"{prefix}_{number:06d}.jpg") for number in chosen]
    present = [file.name for file in files if file.exists()]
    if present:
        raise PhotoError(f"{folder} already holds {present[0]}. Choose another folder, or rename the video.")
    # Before the first file: a call that is killed leaves nothing that the next one would not know.
    names = [file.name for file in files]
    write_json(record, {**key, "files": names, "complete": False})
    for count, (number, pixels) in enumerate(_frames(video, set(chosen)), start=1):
        _write(files[chosen.index(number)], pixels)
        emit(Progress(STAGE, _SHARE_OF_LOOKING + (1 - _SHARE_OF_LOOKING) * count / len(chosen)))
        if should_stop():
            raise Cancelled("Stopped. Run the same command again to continue.")
    if not all(file.is_file() for file in files):
        raise PhotoError(f"{video.name} could not be read a second time. Copy it again, or export it as MP4 (H.264).")
    write_json(record, {**key, "files": names, "complete": True})
    return files


def _read(record: Path, prefix: str) -> dict[str, Any] | None:
    """Return what an earlier call noted; None where there is nothing, or names that are not its own."""
    try:
        known: dict[str, Any] = read_json(record, _SCHEMA, advice="Delete it.")
    except FormatError:
        return None
    # These files are deleted: a damaged record must not name others.
    own = re.compile(re.escape(prefix) + r"_\d{6,}\.jpg")
    return known if all(own.fullmatch(name) for name in known["files"]) else None


def _look_at(video: Path, settings: VideoSettings, emit: Emit, should_stop: StopCheck) -> list[_Look]:
    import cv2

    flow_between = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST)
    n_frames, per_second = _length(video)
    step = max(1, round(per_second / settings.looks_per_second))
    looks: list[_Look] = []
    before: NDArray[np.uint8] | None = None
    for number, pixels in _frames(video, None, step=step):
        gray = np.asarray(cv2.cvtColor(_reduced(pixels, _SHARPNESS_SIDE), cv2.COLOR_BGR2GRAY), np.uint8)
        small = _reduced(gray, _FLOW_SIDE)
        motion = 0.0
        if before is not None:
            flow = np.asarray(flow_between.calc(before, small, None), np.float64)
            motion = float(np.linalg.norm(flow, axis=2).mean()) / small.shape[1]
        before = small
        looks.append(_Look(number, float(cv2.Laplacian(gray, cv2.CV_32F).var()), motion))
        if n_frames:
            emit(Progress(STAGE, min(number / n_frames, 1.0) * _SHARE_OF_LOOKING))
        if should_stop():
            raise Cancelled("Stopped. Run the same command again to continue.")
    return looks


def _chosen(looks: list[_Look], settings: VideoSettings) -> list[int]:
    """Return the numbers of the frames to write, rising."""
    way = np.cumsum([look.motion for look in looks])
    usual = np.clip(way[-1] / settings.motion_between, settings.min_frames, settings.max_frames)
    n_stretches = min(max(int(usual * settings.density), settings.min_frames), len(looks))
    if way[-1] > 0:
        stretch = np.minimum((way / way[-1] * n_stretches).astype(int), n_stretches - 1)
    else:  # nothing moves: as evenly as possible in time
        stretch = np.arange(len(looks)) * n_stretches // len(looks)
    best: dict[int, _Look] = {}
    for look, index in zip(looks, stretch.tolist(), strict=True):
        if index not in best or look.sharpness > best[index].sharpness:
            best[index] = look
    return sorted(look.number for look in best.values())


def _frames(video: Path, wanted: set[int] | None, *, step: int = 1) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """Yield number and pixels (BGR) of the `wanted` frames, or of every `step`-th."""

    if kind_of_file(video) != VIDEO:
        raise PhotoError(f"{video.name} is not a video that can be read. Export it as MP4 (H.264).")
    capture = _opened(video)
    try:
        if not capture.isOpened():
            raise PhotoError(f"{video.name} is not a video that can be read. Export it as MP4 (H.264).")
        last = None if wanted is None else max(wanted)
        number = 0
        # Frames are skipped by reading on: seeking is not exact in many files.
        while (last is None or number <= last) and capture.grab():
            if number in wanted if wanted is not None else number % step == 0:
                ok, pixels = capture.retrieve()
                if ok and pixels is not None:
                    yield number, np.asarray(pixels, np.uint8)
            number += 1
    finally:
        capture.release()


def _opened(video: Path) -> VideoCapture:
    """Open a video as one of the formats that hold their pictures themselves.

    FFmpeg also reads lists of other files and addresses, whatever the name of the list.
    """
    import cv2

    with variable_for_libraries(_OPTIONS_VARIABLE, _OPTIONS):
        return cv2.VideoCapture(str(video), cv2.CAP_FFMPEG)


def _length(video: Path) -> tuple[int, float]:
    """Return number of frames and frames per second as the file states them; 0 and 30 where it does not."""
    import cv2

    capture = _opened(video)
    try:
        n_frames, per_second = capture.get(cv2.CAP_PROP_FRAME_COUNT), capture.get(cv2.CAP_PROP_FPS)
    finally:
        capture.release()
    return max(int(n_frames), 0), per_second if 0 < per_second < 1000 else 30.0


def _reduced(pixels: NDArray[np.uint8], side: int) -> NDArray[np.uint8]:
    import cv2

    scale = side / max(pixels.shape[:2])
    if scale >= 1:
        return pixels
    size = (max(1, round(pixels.shape[1] * scale)), max(1, round(pixels.shape[0] * scale)))
    return np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), np.uint8)


def _write(file: Path, pixels: NDArray[np.uint8]) -> None:
    import cv2

    ok, encoded = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if not ok:
        raise PhotoError(f"{file.name} could not be written as JPEG.")
    write_file(file, encoded.tobytes())
