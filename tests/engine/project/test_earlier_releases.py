"""Projects of earlier releases are opened, changed and exported as they were left."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from engine.project.versions import PROJECT_VERSION
from tests.engine.command_line import ROOT, call

RELEASES = sorted(path for path in (ROOT / "tests" / "fixtures" / "releases").iterdir() if path.is_dir())
MOST_BYTES = 300_000
"""Of all files of a release: they stay in the repository for ever."""


@pytest.fixture(params=RELEASES, ids=lambda release: release.name)
def project(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """Return a copy of a release's project."""
    return Path(shutil.copytree(request.param / "project", tmp_path / "project"))


def test_there_is_a_small_project_of_each_release() -> None:
    assert [release.name for release in RELEASES] == ["0.2.0"]
    for release in RELEASES:
        assert sum(file.stat().st_size for file in release.rglob("*") if file.is_file()) <= MOST_BYTES
        stored = json.loads((release / "project" / "project.json").read_text(encoding="utf-8"))
        assert stored["version"] <= PROJECT_VERSION and stored["engine_version"] == release.name


def test_its_object_is_exported_with_its_size(
    project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = call(
        capsys, "export", project, "--object", "Exhibit", "--format", "ply", "--out", tmp_path / "exhibit.ply"
    )
    assert answer.code == 0, answer.error
    head = (tmp_path / "exhibit.ply").read_bytes().partition(b"end_header")[0].decode()
    assert "comment unit metre" in head
    (n,) = [int(line.split()[-1]) for line in head.splitlines() if line.startswith("element vertex")]
    assert 0 < n < 400


def test_it_is_rendered_renamed_and_measured_as_one_of_this_version(
    project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / "view.png"
    for words in (
        ("render", project, "--view", "view_08.jpg", "--out", picture),
        ("edit", project, "--rename", "exhibit=Jug"),
        ("measure", project, "--between", "xyz=0,0,0", "xyz=0,2,0"),
    ):
        answer = call(capsys, *words)
        assert answer.code == 0, answer.error
    assert picture.stat().st_size > 1000
    assert json.loads((project / "objects" / "exhibit" / "object.json").read_text(encoding="utf-8"))["name"] == "Jug"
    assert answer.of_kind("finished")[0]["message"].endswith("Between: 5 m.")
