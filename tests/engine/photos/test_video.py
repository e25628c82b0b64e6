"""A video gives sharp photos, evenly by the motion of the camera, and is continued and refused with a sentence."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from engine.core.errors import Cancelled, PhotoError
from engine.core.events import ignore_events, never_stop
from engine.photos import extract_frames, is_video
from engine.photos import video as video_module
from engine.photos.settings import VideoSettings

from .opencv import read_picture

SIDE = 256
SETTINGS = VideoSettings(min_frames=4, max_frames=20, motion_between=0.1, looks_per_second=30)


def write_video(path: Path, offsets: list[int], blurred: set[int] = frozenset()) -> Path:  # type: ignore[assignment]
    """Write a camera that moves over a picture: one frame for each offset in pixels."""
    rng = np.random.default_rng(0)
    width = max(offsets) + SIDE
    texture = cv2.resize(rng.integers(0, 255, (SIDE // 4, width // 4, 3), np.uint8), (width, SIDE))
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 30, (SIDE, SIDE))
    for number, offset in enumerate(offsets):
        frame = texture[:, offset : offset + SIDE]
        writer.write(cv2.GaussianBlur(frame, (0, 0), 4) if number in blurred else frame)
    writer.release()
    return path


def frames_of(video: Path, out: Path, settings: VideoSettings = SETTINGS) -> list[int]:
    files = extract_frames(video, out, settings, emit=ignore_events, should_stop=never_stop)
    assert all(read_picture(file).shape == (SIDE, SIDE, 3) for file in files)
    return [int(file.stem.rpartition("_")[2]) for file in files]


def test_resting_camera_gives_few_photos_and_a_moving_one_many(tmp_path: Path) -> None:
    video = write_video(tmp_path / "a.mp4", [0] * 40 + [4 * step for step in range(60)])
    numbers = frames_of(video, tmp_path / "out")
    assert 6 <= len(numbers) <= 14
    assert sum(number < 40 for number in numbers) <= 2
    # A stretch is 25.6 pixels, 6.4 frames; two sharpest frames are at most two stretches apart.
    assert np.diff([number for number in numbers if number >= 40]).max() <= 14


def test_blurred_frames_are_not_taken(tmp_path: Path) -> None:
    blurred = {number for number in range(60) if number % 4}
    video = write_video(tmp_path / "a.mp4", [4 * step for step in range(60)], blurred)
    numbers = frames_of(video, tmp_path / "out")
    assert len(numbers) >= 4 and sum(number in blurred for number in numbers) <= 1


def test_number_of_photos_is_limited(tmp_path: Path) -> None:
    video = write_video(tmp_path / "a.mp4", [8 * step for step in range(60)])
    settings = VideoSettings(min_frames=3, max_frames=5, motion_between=0.01, looks_per_second=30)
    assert 3 <= len(frames_of(video, tmp_path / "out", settings)) <= 5


@pytest.mark.parametrize("offsets", [[4 * step for step in range(60)], [step // 3 for step in range(60)]])
def test_more_photos_are_taken_by_the_density(tmp_path: Path, offsets: list[int]) -> None:
    """Of a camera that moves much and of one that hardly moves."""
    video = write_video(tmp_path / "a.mp4", offsets)
    usual = len(frames_of(video, tmp_path / "out"))
    # A stretch without any look gives no photo.
    assert 1.6 * usual <= len(frames_of(video, tmp_path / "out", replace(SETTINGS, density=2))) <= 2 * usual + 1


def test_second_call_reuses_what_is_there_and_other_settings_replace_it(tmp_path: Path) -> None:
    video, out = write_video(tmp_path / "a.mp4", [4 * step for step in range(60)]), tmp_path / "out"
    numbers = frames_of(video, out)
    (out / "mine.jpg").write_bytes(b"kept")
    changed = {file: file.stat().st_mtime_ns for file in out.iterdir()}
    assert frames_of(video, out) == numbers
    assert {file: file.stat().st_mtime_ns for file in out.iterdir()} == changed
    fewer = frames_of(video, out, VideoSettings(min_frames=3, max_frames=4, looks_per_second=30))
    assert sorted(path.suffix for path in out.iterdir()) == [".jpg"] * (len(fewer) + 1) + [".json"]


def test_stopped_call_leaves_nothing_that_the_next_one_does_not_replace(tmp_path: Path) -> None:
    video, out = write_video(tmp_path / "a.mp4", [4 * step for step in range(60)]), tmp_path / "out"
    calls = iter(range(10_000))
    with pytest.raises(Cancelled):
        extract_frames(video, out, SETTINGS, emit=ignore_events, should_stop=lambda: next(calls) > 62)
    assert list(out.glob("*.jpg"))
    numbers = frames_of(video, out)
    assert len(list(out.glob("*.jpg"))) == len(numbers)


def test_photo_of_the_user_is_never_overwritten(tmp_path: Path) -> None:
    video, out = write_video(tmp_path / "a.mp4", [4 * step for step in range(60)]), tmp_path / "out"
    first = frames_of(video, tmp_path / "other")[0]
    out.mkdir()
    mine = out / f"frame_{first:06d}.jpg"
    mine.write_bytes(b"mine")
    with pytest.raises(PhotoError, match="already holds"):
        frames_of(video, out)
    assert mine.read_bytes() == b"mine" and list(out.iterdir()) == [mine]


@pytest.mark.parametrize("content", [b"", b"no video", b"\0\0\0\x18ftypmp42" + b"\0" * 100])
def test_what_is_no_video_is_refused(tmp_path: Path, content: bytes) -> None:
    video = tmp_path / "a.mp4"
    video.write_bytes(content)
    assert is_video(video)
    with pytest.raises(PhotoError, match="is not a video that can be read|usable frames"):
        frames_of(video, tmp_path / "out")


def test_video_that_is_too_short_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PhotoError, match="2 usable frames, and 4 are needed"):
        frames_of(write_video(tmp_path / "a.mp4", [0, 4]), tmp_path / "out")


def test_list_of_other_files_is_no_video_whatever_its_name(tmp_path: Path) -> None:
    write_video(tmp_path / "secret.mp4", [0, 10, 20, 30, 40, 50])
    lists = {
        "concat.mp4": b"ffconcat version 1.0\nfile secret.mp4\n",
        "playlist.mov": b"#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\nsecret.mp4\n#EXT-X-ENDLIST\n",
    }
    for name, content in lists.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(PhotoError, match=f"{name} is not a video that can be read"):
            extract_frames(
                tmp_path / name, tmp_path / "out", SETTINGS, emit=ignore_events, should_stop=never_stop, prefix="f"
            )
        assert not video_module._opened(tmp_path / name).isOpened()
    assert not list((tmp_path / "out").glob("*.jpg"))
