"""What ran is recorded with every stage."""

from __future__ import annotations

from pathlib import Path

import pytest

from engine.core.files import check
from engine.pipeline.runner import StageRunner
from engine.project import provenance
from engine.project.folder import ProjectFolder
from engine.project.provenance import RUN, code_version, describe_run, software_versions


def test_stage_records_software_commit_settings_and_seed(tmp_path: Path) -> None:
    with ProjectFolder.create(tmp_path / "project") as project:
        runner = StageRunner(project, lambda event: None, lambda: False)
        runner.run("cameras", "key", dict, settings={"seed": 7, "max_side": 640})
    stored = ProjectFolder.open_existing(tmp_path / "project").stage_record("cameras")
    assert stored is not None
    run = stored["run"]
    assert run["seed"] == 7
    assert run["settings"] == {"seed": 7, "max_side": 640}
    assert run["software"] == software_versions()
    assert check(run, RUN) is None


def test_step_that_draws_nothing_has_no_seed() -> None:
    assert describe_run({"max_side": 640})["seed"] is None


def test_code_that_is_no_checkout_has_no_commit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(provenance, "CODE_ROOT", tmp_path)
    code_version.cache_clear()
    try:
        assert code_version() == (None, None)
    finally:
        code_version.cache_clear()


def test_git_is_not_started_where_the_code_is_no_checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a Mac without developer tools, macOS would ask to install them."""
    started: list[tuple[str, ...]] = []
    monkeypatch.setattr(provenance, "CODE_ROOT", tmp_path)
    monkeypatch.setattr(provenance, "_git", lambda *words: started.append(words))
    code_version.cache_clear()
    try:
        assert code_version() == (None, None) and started == []
    finally:
        code_version.cache_clear()


def test_code_in_the_checkout_of_another_project_has_no_commit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # An extension that was installed below a folder that is under version control.
    monkeypatch.setattr(provenance, "CODE_ROOT", Path(__file__).parent)
    code_version.cache_clear()
    try:
        assert code_version() == (None, None)
    finally:
        code_version.cache_clear()
