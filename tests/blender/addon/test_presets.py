"""Presets: a choice with times for the photos at hand, and from a preview to a better scene by one button."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from conftest import FakeLayout, Part, write_object

pytestmark = pytest.mark.once

ADDON = "gaussian_heritage_addon"
MEMBERSHIP = np.linspace(0, 1, 100, dtype=np.float32)
FORECAST = (
    "say('finished', message='', outputs={'presets': [{'name': name, 'forecast': {'stages': ["
    "{'stage': 'cameras', 'seconds': 60.0}, {'stage': 'training', 'seconds': seconds}]}}"
    " for name, seconds in (('preview', 60.0), ('standard', 240.0), ('best', 3540.0))]})"
)


@pytest.fixture
def times(part: Part) -> Iterator[ModuleType]:
    module = part(f"{ADDON}.jobs.preset_times")
    yield module
    module.stop()
    module._known.clear()


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    folder = tmp_path / "Fotos Böhmen"
    folder.mkdir()
    (folder / "a.JPG").write_bytes(b"")
    return folder


def drawn_import(part: Part, photos: Path) -> FakeLayout:
    operator, layout = part("operators.import_photos").HERITAGE_OT_import_photo_folder, FakeLayout()
    space = SimpleNamespace(type="FILE_BROWSER", params=SimpleNamespace(directory=str(photos).encode()))
    context = SimpleNamespace(area=space, space_data=space)
    fake = SimpleNamespace(layout=layout, bl_rna=bpy.ops.heritage.import_photo_folder.get_rna_type())
    fake._shown_photos = lambda context: operator._shown_photos(fake, context)
    operator.draw(fake, context)
    return layout


def wait_for(times: ModuleType) -> None:
    """Poll until the engine has answered."""
    while times.poll() is not None:
        time.sleep(0.02)


def test_presets_are_a_choice_and_no_free_text(blender: ModuleType, tmp_path: Path) -> None:
    preset = bpy.ops.heritage.import_photo_folder.get_rna_type().properties["preset"]
    assert preset.type == "ENUM" and {"preview", "standard", "best", "test"} <= set(preset.enum_items.keys())
    with pytest.raises(TypeError, match="fast"):
        bpy.ops.heritage.import_photo_folder(directory=str(tmp_path), preset="fast")


def test_file_browser_says_what_each_preset_is_for_and_takes_for_these_photos(
    part: Part, times: ModuleType, photos: Path, fake_engine: Callable[[str], Path]
) -> None:
    arguments = fake_engine(FORECAST)
    before = drawn_import(part, photos)
    assert "A first look at the scene." in before.texts and "Reading these photos" in " ".join(before.texts)
    wait_for(times)
    assert json.loads(arguments.read_text(encoding="utf-8")) == [
        "-m",
        "engine",
        "plan",
        str(photos),
        "--every-preset",
        "--events",
    ]
    texts = drawn_import(part, photos).texts
    assert [text for text in texts if text.startswith("About")] == [
        f"About {minutes} min for these photos" for minutes in (2, 5, 60)
    ]
    assert {"Objects to Isolate", "Known Cameras", "Folder of Masks", "Project Folder"} <= set(texts)
    assert "paper" not in texts


def test_file_browser_says_how_far_the_engine_is(
    part: Part, times: ModuleType, photos: Path, fake_engine: Callable[[str], Path], tmp_path: Path
) -> None:
    go_on = tmp_path / "go on"
    fake_engine(
        "import time\n"
        "say('progress', stage='photos', fraction=0.25, seconds_left=None, message='12 of 48 photos')\n"
        f"while not Path({str(go_on)!r}).exists(): time.sleep(0.02)\n" + FORECAST
    )
    drawn_import(part, photos)
    while not times.progress():
        assert times.poll() is not None
        time.sleep(0.02)
    assert "12 of 48 photos" in drawn_import(part, photos).texts
    go_on.touch()
    wait_for(times)
    assert "12 of 48 photos" not in drawn_import(part, photos).texts and times.preset_seconds(photos)


def test_folder_without_photos_starts_no_engine(
    part: Part, times: ModuleType, tmp_path: Path, fake_engine: Callable[[str], Path]
) -> None:
    arguments = fake_engine(FORECAST)
    (tmp_path / "empty").mkdir()
    texts = drawn_import(part, tmp_path / "empty").texts
    assert times.poll() is None and not arguments.exists() and "Reading" not in " ".join(texts)


def test_photos_that_the_engine_cannot_forecast_are_asked_about_once(
    part: Part, times: ModuleType, photos: Path, fake_engine: Callable[[str], Path]
) -> None:
    fake_engine("say('error', message='no photos', error='PhotoError'); sys.exit(1)")
    drawn_import(part, photos)
    wait_for(times)
    assert times.preset_seconds(photos) == {}
    assert not any(text.startswith(("About", "Reading")) for text in drawn_import(part, photos).texts)


def trained(project: Any, part: Part, photos: Path, preset: str = "preview", **given: Any) -> None:
    """Let the project say that it was made from `photos` with `preset`."""
    folder = part("engine.project.folder").ProjectFolder.open_existing(project.folder)
    figures = {"preset": preset}
    folder.finish_stage("training", "key", wall_seconds=1.0, cpu_seconds=1.0, figures=figures)
    source = part("engine.pipeline.reconstruction_input")
    source.store_input(folder, source.ReconstructionInput(str(photos), **given))


def test_preview_becomes_standard_by_one_button(
    opened: Any, part: Part, photos: Path, tmp_path: Path, draw: Callable[[str], FakeLayout],
    fake_engine: Callable[[str], Path],
) -> None:  # fmt: skip
    masks = tmp_path / "masks"
    masks.mkdir()
    trained(opened, part, photos, photo_masks=str(masks))
    write_object(opened.folder, "vase", "Meissen", MEMBERSHIP, prompt={"kind": "text", "text": "vase, teapot"})
    arguments = fake_engine("say('finished', message='done', outputs={})")
    assert draw("HERITAGE_PT_scene").button("improve_scene") == {"preset": "standard"}
    assert bpy.ops.heritage.improve_scene(preset="standard") == {"FINISHED"}
    assert json.loads(arguments.read_text(encoding="utf-8"))[2:] == [
        "reconstruct", str(photos), "--out", str(opened.folder), "--preset", "standard", f"--photo-masks={masks}",
        "--prompts=\"vase, teapot\"", "--events",
    ]  # fmt: skip


def test_best_scene_offers_nothing_better(
    opened: Any, part: Part, photos: Path, draw: Callable[[str], FakeLayout]
) -> None:
    trained(opened, part, photos, "best")
    assert "heritage.improve_scene" not in [name for name, _ in draw("HERITAGE_PT_scene").buttons]
    with pytest.raises(RuntimeError, match="best preset already"):
        bpy.ops.heritage.improve_scene()


def test_missing_photos_are_named_before_anything_is_trained(opened: Any, part: Part, photos: Path) -> None:
    trained(opened, part, photos / "gone")
    with pytest.raises(RuntimeError, match="gone, from which the scene was made, is not there"):
        bpy.ops.heritage.improve_scene(preset="standard")


def test_objects_edited_by_hand_are_stored_before_the_scene_changes(opened: Any, part: Part, photos: Path) -> None:
    trained(opened, part, photos)
    (vase,) = [obj for obj in bpy.data.objects if obj.heritage.role == "OBJECT"]
    vase.heritage.is_edited = True
    with pytest.raises(RuntimeError, match="edited by hand"):
        bpy.ops.heritage.improve_scene(preset="standard")


def test_dialog_says_what_becomes_of_the_objects(opened: Any, part: Part) -> None:
    write_object(opened.folder, "vase", "Meissen", MEMBERSHIP, prompt={"kind": "text", "text": "vase"})
    write_object(opened.folder, "cup", "Cup", MEMBERSHIP, prompt={"kind": "click", "photo": "a.jpg"})
    lines = " ".join(part("operators.improve_scene")._consequences(opened.folder, "standard", {"standard": 240.0}))
    for words in (
        "2 objects",
        "trash",
        "Searched for again by their words: vase.",
        "About 4 min",
        "without the search",
        "clicked",
    ):
        assert words in lines, words


def test_dialog_says_that_the_time_is_worked_out_and_shows_it_then(
    opened: Any, part: Part, photos: Path, times: ModuleType, fake_engine: Callable[[str], Path],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    trained(opened, part, photos)
    fake_engine(FORECAST)
    operator = part("operators.improve_scene").HERITAGE_OT_improve_scene
    drawn: list[str] = []
    popup = SimpleNamespace(tag_refresh_ui=lambda: drawn.append("again"), tag_redraw=lambda: None)
    context = SimpleNamespace(
        scene=bpy.context.scene, region_popup=popup, window_manager=SimpleNamespace(
            invoke_props_dialog=lambda *_, **options: {"RUNNING_MODAL"}
        ),
    )  # fmt: skip
    dialog = SimpleNamespace(preset="NEXT", layout=FakeLayout(), _wanted=lambda project: "standard")
    operator.invoke(dialog, context, None)
    operator.draw(dialog, context)
    assert "Working out how long this takes ..." in dialog.layout.texts
    wait_for(times)
    assert drawn == ["again"]
    dialog.layout = FakeLayout()
    operator.draw(dialog, context)
    # Cameras and masks are kept: only the training counts.
    assert "About 4 min on this computer." in dialog.layout.texts
    assert "Working out how long this takes ..." not in dialog.layout.texts
    # Blender frees the region of a dialog that was closed.
    operator.cancel(dialog, context)
    part(f"{ADDON}.blender.open_dialog").redraw_dialog()
    assert drawn == ["again"]
