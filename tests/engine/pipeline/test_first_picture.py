"""A picture of the scene is seen while the cameras are estimated."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from engine.core import child_process
from engine.core.errors import CameraError, Cancelled
from engine.core.events import Event, Preview, ignore_events, never_stop
from engine.core.parts import measured_parts
from engine.photos import PhotoStatistics
from engine.pipeline import reconstruct
from engine.pipeline.first_picture import MIN_PHOTOS, FirstPicture
from engine.pipeline.planning import PlannedWork, PlanSettings
from engine.pipeline.reconstruct import PipelineSettings
from engine.pipeline.runner import parts_by_message
from engine.scene import Photo, PhotoSet
from engine.training.settings import PREVIEW_FILE

PHOTOS = PhotoSet(Path("photos"), tuple(Photo(f"{k:03}.jpg", 640, 480, None, "") for k in range(MIN_PHOTOS)), ())


class Child:
    """In the place of the process."""

    def __init__(self) -> None:
        self.given: dict[str, Any] = {}
        self.is_over = False
        self.error: Exception | None = None

    @contextmanager
    def work(self, function: str, given: dict[str, Any], *, what: str) -> Iterator[Child]:
        self.given = given
        yield self
        self.is_over = True

    def end(self) -> None:
        self.is_over = True
        if self.error:
            raise self.error


@pytest.fixture
def child(monkeypatch: pytest.MonkeyPatch) -> Child:
    one = Child()
    monkeypatch.setattr(child_process, "child_beside", one.work)
    return one


def test_followers_see_each_state_of_the_picture_once_and_no_file_of_it_stays(child: Child, tmp_path: Path) -> None:
    seen: list[Event] = []
    with FirstPicture(tmp_path, PHOTOS, "OPENCV", seen.append) as picture:
        should_stop = picture.watched_by(never_stop)
        picture.start()
        assert not should_stop() and seen == []
        file = Path(child.given["folder"]) / PREVIEW_FILE
        file.parent.mkdir()
        for state in range(2):
            file.write_bytes(bytes(state))
            # Two writes may have the same time.
            picture._seen = 0
            should_stop()
        picture._seen = file.stat().st_mtime_ns
        should_stop()
        assert [event.path for event in seen if isinstance(event, Preview)] == [str(file)] * 2
        picture.end()
        # Viewers may still load it until training shows its own.
        assert child.is_over and file.exists()
    assert list(tmp_path.iterdir()) == []


def test_thread_that_asks_while_another_looks_goes_on_and_the_picture_is_told_once(
    child: Child, tmp_path: Path
) -> None:
    seen: list[Event] = []

    def emit(event: Event) -> None:
        seen.append(event)
        picture._seen = 0  # as if there were another picture meanwhile
        with ThreadPoolExecutor(1) as other:
            assert not other.submit(should_stop).result()

    with FirstPicture(tmp_path, PHOTOS, "OPENCV", emit) as picture:
        should_stop = picture.watched_by(never_stop)
        picture.start()
        file = Path(child.given["folder"]) / PREVIEW_FILE
        file.parent.mkdir()
        file.touch()
        should_stop()
        assert len(seen) == 1
        should_stop()
    assert len(seen) == 2


def test_picture_is_made_of_photos_from_all_around_with_the_lens_of_the_run(child: Child, tmp_path: Path) -> None:
    with FirstPicture(tmp_path, PHOTOS, "OPENCV", [].append) as picture:
        picture.start()
    names = child.given["names"]
    assert child.given["lens"] == "OPENCV"
    assert len(set(names)) == len(names) == MIN_PHOTOS // 2
    assert names[0] == "000.jpg" and names[-1] == f"{MIN_PHOTOS - 1:03}.jpg"
    assert max(int(b[:3]) - int(a[:3]) for a, b in zip(names, names[1:], strict=False)) <= 3


def test_photos_that_do_not_fit_together_do_not_end_the_run(child: Child, tmp_path: Path) -> None:
    child.error = CameraError("Only 2 of 16 photos could be placed.")
    with FirstPicture(tmp_path, PHOTOS, "OPENCV", [].append) as picture:
        picture.start()
        picture.end()
    assert child.is_over


def test_cancelled_run_leaves_no_process(child: Child, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), FirstPicture(tmp_path, PHOTOS, "OPENCV", [].append) as picture:
        picture.start()
        raise KeyboardInterrupt
    assert child.is_over


def test_time_of_a_stage_is_told_by_what_its_progress_says() -> None:
    from engine.core.events import Progress

    with measured_parts(lambda: 0.0) as account, parts_by_message(lambda event: None) as emit:
        for message in ("features in 1 of 48 photos", "features in 2 of 48 photos", "", "12 of 908 pairs matched"):
            emit(Progress("cameras", 0.5, message=message))
    assert set(account.as_json()) == {"", "features in photos", "pairs matched"}


@pytest.mark.parametrize(
    ("is_followed", "count", "until", "is_made"),
    [
        (True, MIN_PHOTOS, "report", True),
        (False, MIN_PHOTOS, "report", False),
        (True, MIN_PHOTOS - 1, "report", False),
        (True, MIN_PHOTOS, "masks", False),
    ],
    ids=["followed", "nobody sees it", "few photos", "no training"],
)
def test_picture_is_made_for_those_who_follow_a_run_of_many_photos_to_its_training(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, is_followed: bool, count: int, until: str, is_made: bool
) -> None:
    photos = replace(PHOTOS, photos=PHOTOS.photos[:count])
    looks = [PhotoStatistics(photo.name, 0.5) for photo in photos.photos]
    plan_and_forecast, begun = reconstruct.plan_and_forecast, list[object]()

    def planned(*given: Any, **named: Any) -> PlannedWork:
        found = plan_and_forecast(*given, **named)
        return found._replace(forecast=replace(found.forecast, masks_beside=0, picture_beside=True))

    def cameras_stage(*_: object, beside: list[object], **__: object) -> None:
        begun.extend(beside)
        raise Cancelled("Stopped.")

    monkeypatch.setattr(reconstruct, "photos_stage", lambda *_, **__: (photos, looks))
    monkeypatch.setattr(reconstruct, "plan_and_forecast", planned)
    monkeypatch.setattr(reconstruct, "cameras_stage", cameras_stage)
    settings = PipelineSettings(plan=PlanSettings(preset="test", device="cpu"), is_followed=is_followed)
    with pytest.raises(Cancelled):
        reconstruct.reconstruct(
            tmp_path / "photos", tmp_path / "scene", settings, emit=ignore_events, should_stop=never_stop, until=until
        )
    assert [type(one) for one in begun] == [FirstPicture] * is_made
