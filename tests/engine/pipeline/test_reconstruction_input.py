"""A project says what it was made from, so that its scene can be made again with another preset."""

from __future__ import annotations

from pathlib import Path

import pytest

from engine.cli.main import main
from engine.core.errors import ProjectError
from engine.pipeline.reconstruction_input import better_preset, read_input, repeat_arguments
from engine.project.folder import ProjectFolder
from tests.engine.museum import VIEWS, write_cameras, write_photos


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """Return a project whose photos stage is done."""
    photos = write_photos(tmp_path / "photos")
    cameras = write_cameras(tmp_path, {f"view_{view:02}.jpg": view for view in VIEWS})
    command = ["reconstruct", str(photos), "--out", str(tmp_path / "scene"), "--preset", "preview", "--until", "photos"]
    assert main([*command, "--cameras", str(cameras), "--transients", "--light"]) == 0
    return tmp_path / "scene"


def test_options_of_the_first_run_are_repeated(project: Path, tmp_path: Path) -> None:
    given = read_input(project)
    assert given.photos == str(tmp_path / "photos") and given.cameras is not None and given.exclude_transients
    assert given.light and given.wants_objects
    assert repeat_arguments(project, "standard") == [
        "reconstruct", given.photos, "--out", str(project), "--preset", "standard", f"--cameras={given.cameras}",
        "--transients", "--light",
    ]  # fmt: skip
    # The engine's own parser takes them.
    assert main([*repeat_arguments(project, "standard"), "--until", "photos"]) == 0
    assert read_input(project) == given


@pytest.mark.parametrize(("preset", "better"), [("preview", "standard"), ("standard", "best"), ("best", ""), ("x", "")])
def test_next_better_preset_is_that_of_the_list(project: Path, preset: str, better: str) -> None:
    assert better_preset(project) == ""
    folder = ProjectFolder.open_existing(project)
    folder.finish_stage("training", "key", wall_seconds=1.0, cpu_seconds=1.0, figures={"preset": preset})
    assert better_preset(project) == better


@pytest.mark.parametrize("photos", ["--out=/elsewhere", "photos", "/gone/photos", 3, None])
def test_paths_that_could_be_options_or_are_gone_are_refused(project: Path, photos: object) -> None:
    ProjectFolder.open_existing(project).put("input", {"photos": photos})
    with pytest.raises(ProjectError, match="photo"):
        read_input(project)
