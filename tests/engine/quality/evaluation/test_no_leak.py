"""Photos that an object is compared in take no part in isolating it: nothing reads, segments or renders them before."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from engine.core.errors import SettingsError
from engine.core.events import Event, Progress, ignore_events, never_stop
from engine.masks.embeddings import EmbeddingFolder
from engine.masks.storage import label_map_path, write_label_map
from engine.objects.views import Views
from engine.project.folder import ProjectFolder
from engine.quality.evaluation import trained_scene
from engine.quality.evaluation.isolation import evaluate_project
from engine.quality.evaluation.settings import EvaluationSettings
from tests.engine.objects.fakes import FakeDetector, FakeSam, trained_project
from tests.engine.pictures.blob_scene import BlobScene
from tests.engine.quality.evaluation.blob_truth import HELD_OUT, held_out, write_truth

KINDS = ("text", "mask", "click", "all")
SEGMENTED = ("view_1.png", "view_4.png", *HELD_OUT)
"""Photos with label maps: fewer than the levels want, so that a search for more photos would find the others."""

_watchers: list[Watcher] = []


class Watcher:
    """Notes every file that is opened, every child process, and every view that is rendered, while it watches.

    Files are seen by an audit hook of Python, below all of our readers and Pillow.
    """

    def __init__(self) -> None:
        self.watching = True
        self.opened: list[str] = []
        self.rendered: list[str] = []
        self.isolated_late = 0

    def note(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Keep the name of a file, or the whole command of a child process."""
        if self.watching and event == "open" and isinstance(arguments[0], str | bytes | os.PathLike):
            self.opened.append(os.fsdecode(arguments[0]))
        elif self.watching and event in ("subprocess.Popen", "os.posix_spawn", "os.exec"):
            self.opened.append(str(arguments))

    def emit(self, event: Event) -> None:
        """Stop watching when the first photo is compared: from then on photos may be read."""
        if isinstance(event, Progress) and event.message.startswith("Comparing with"):
            self.watching = False

    def touched(self, photos: tuple[str, ...]) -> set[str]:
        """Return those of `photos` of which a photo, a label map or an embedding was opened, or a view rendered."""
        opened = {photo for photo in photos for path in self.opened if photo in path and "/truth/" not in path}
        return opened | (set(photos) & set(self.rendered))


def _audit(event: str, arguments: tuple[Any, ...]) -> None:
    for watcher in _watchers:
        watcher.note(event, arguments)


sys.addaudithook(_audit)


@contextmanager
def watched(monkeypatch: pytest.MonkeyPatch) -> Iterator[Watcher]:
    watcher = Watcher()
    render = Views.of

    def rendered(self: Views, camera: Any) -> Any:
        if watcher.watching:
            watcher.rendered.append(camera.photo)
        return render(self, camera)

    def timely(function: Callable[..., Any]) -> Callable[..., Any]:
        def called(*arguments: Any, **others: Any) -> Any:
            watcher.isolated_late += not watcher.watching
            return function(*arguments, **others)

        return called

    monkeypatch.setattr(Views, "of", rendered)
    for name in ("find_objects", "find_everything"):
        monkeypatch.setattr(trained_scene, name, timely(getattr(trained_scene, name)))
    _watchers.append(watcher)
    try:
        yield watcher
    finally:
        _watchers.remove(watcher)


def segmented_project(blobs: BlobScene, folder: Path) -> ProjectFolder:
    """A project with label maps, and with embeddings of all photos."""
    project = held_out(trained_project(blobs, folder))
    embeddings = EmbeddingFolder(project.path / "masks")
    for photo, pixels in blobs.pixels.items():
        embeddings.encode(photo, pixels, FakeSam(blobs))  # type: ignore[arg-type]
        if photo in SEGMENTED:
            write_label_map(label_map_path(project.path / "masks", photo), blobs.labels[photo])
    return project


def evaluated(blobs: BlobScene, project: ProjectFolder, truth: Path, emit: Any = ignore_events, **settings: Any) -> Any:
    return evaluate_project(
        project, truth, EvaluationSettings(**settings), detector_factory=lambda: FakeDetector(blobs),  # type: ignore[arg-type]
        sam_factory=lambda: FakeSam(blobs), emit=emit, should_stop=never_stop,  # type: ignore[arg-type]
    )  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_touches_a_compared_photo_before_everything_is_isolated(
    kind: str, blobs: BlobScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = segmented_project(blobs, tmp_path)
    truth = write_truth(blobs, tmp_path / "truth", absent=("ghost",))
    with watched(monkeypatch) as watcher:
        found = evaluated(
            blobs, project, truth, watcher.emit, prompt_kind=kind, presets=("paper", "released", "better")
        )
    assert found.photos == HELD_OUT and not watcher.watching and watcher.isolated_late == 0
    assert watcher.touched(HELD_OUT) == set()
    # Others were looked at, so the watcher can see.
    others = tuple(photo for photo in blobs.pixels if photo not in HELD_OUT)
    assert len(watcher.touched(others)) > 4 and found.looked_at == others


@pytest.mark.parametrize("kind", KINDS)
def test_with_all_views_the_watcher_sees_compared_photos(
    kind: str, blobs: BlobScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = segmented_project(blobs, tmp_path)
    truth = write_truth(blobs, tmp_path / "truth")
    with watched(monkeypatch) as watcher:
        found = evaluated(blobs, project, truth, watcher.emit, prompt_kind=kind, views="all", presets=("better",))
    assert watcher.touched(HELD_OUT) == set(HELD_OUT) and set(found.looked_at) == set(found.photos)
    opened = [path for path in watcher.opened if any(photo in path for photo in HELD_OUT) and "/truth/" not in path]
    # Label maps, their embeddings, and where the method reads pixels the photos themselves.
    endings = {path.partition(".png")[2] for path in opened}
    assert {".npz", ".sam.npz"} <= endings and ("" in endings) == (kind in ("text", "all", "click"))


@pytest.mark.parametrize("kind", KINDS)
def test_what_compared_photos_show_changes_no_membership(
    kind: str, blobs: BlobScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    truth = write_truth(blobs, tmp_path / "truth", absent=("ghost",))
    random = np.random.default_rng(0)
    memberships: list[list[np.ndarray]] = []
    for name in ("intact", "noise"):
        project = segmented_project(blobs, tmp_path / name)
        for photo in HELD_OUT if name == "noise" else ():
            noise = random.integers(0, 256, blobs.pixels[photo].shape, np.uint8)
            Image.fromarray(noise).save(tmp_path / name / "photos" / photo)
            labels = random.integers(0, 40, blobs.labels[photo].shape, np.int32)
            write_label_map(label_map_path(project.path / "masks", photo), labels)
            shutil.copyfile(tmp_path / name / "photos" / photo, project.path / "masks" / f"{photo}.sam.npz")
        returned: list[np.ndarray] = []
        with monkeypatch.context() as patch:
            for function in ("find_objects", "find_everything"):
                original = getattr(trained_scene, function)

                def recorded(
                    *arguments: Any, original: Any = original, returned: list[np.ndarray] = returned, **others: Any
                ) -> Any:
                    found = original(*arguments, **others)
                    returned.extend(one.membership for one in found)
                    return found

                patch.setattr(trained_scene, function, recorded)
            evaluated(blobs, project, truth, prompt_kind=kind, presets=("better",))
        memberships.append(returned)
    intact, noisy = memberships
    assert len(intact) == len(noisy) > 1
    assert all(np.array_equal(one, other) for one, other in zip(intact, noisy, strict=True))


@pytest.mark.parametrize("kind", ["mask", "click"])
def test_photo_given_up_for_a_prompt_is_the_only_one_with_true_masks_that_is_looked_at(
    kind: str, blobs: BlobScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = segmented_project(blobs, tmp_path)
    truth = write_truth(blobs, tmp_path / "truth", photos=HELD_OUT)
    looked_at = []

    def record(context: Any, prompt: Any, *arguments: Any, **others: Any) -> Any:
        looked_at.append((prompt.photo, {camera.photo for camera in context.views.cameras.cameras}))
        assert not set(context.label_maps) & set(HELD_OUT)
        return original(context, prompt, *arguments, **others)

    original = trained_scene.find_objects
    monkeypatch.setattr(trained_scene, "find_objects", record)
    found = evaluated(blobs, project, truth, prompt_kind=kind, presets=("better",))
    assert len(looked_at) == len(found.rows) > 1
    for (photo, cameras), row in zip(looked_at, found.rows, strict=True):
        assert cameras & set(HELD_OUT) == {photo} == {row.prompt_photo}
        assert row.n_views == 1 and row.iou > 0.9


def test_a_project_is_refused_when_no_photo_is_left_to_look_at(blobs: BlobScene, tmp_path: Path) -> None:
    project = held_out(trained_project(blobs, tmp_path), tuple(blobs.pixels))
    with pytest.raises(SettingsError, match="Every photo is compared, so none is left to isolate objects from"):
        evaluated(blobs, project, write_truth(blobs, tmp_path / "truth"), prompt_kind="text")
