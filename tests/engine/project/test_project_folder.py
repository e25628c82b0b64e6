"""The job on disk: nothing half-written, one writer, a killed run continues."""

from __future__ import annotations

import errno
import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from engine.core.errors import DiskError, FormatError, ProjectError, ProjectInUse
from engine.core.files import atomic_write, finite_or_null, write_json
from engine.project.content import scene_file
from engine.project.folder import ProjectFolder, stage_key
from tests.engine.command_line import call
from tests.engine.finished_project import write_finished_project


def test_failing_rename_leaves_the_old_file_and_no_leftovers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "a.json"
    write_json(target, {"old": 1})

    def refuse(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", refuse)
    with pytest.raises(DiskError, match=r"a\.json: No space left on device"):
        write_json(target, {"new": 2})
    assert json.loads(target.read_text(encoding="utf-8")) == {"old": 1}
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]


def test_error_while_writing_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="mine"), atomic_write(tmp_path / "x.bin") as stream:
        stream.write(b"half")
        raise ValueError("mine")
    assert list(tmp_path.iterdir()) == []


def test_folder_with_other_files_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.docx").write_text("precious")
    with pytest.raises(ProjectError, match="already holds files"):
        ProjectFolder.create(tmp_path)
    assert (tmp_path / "thesis.docx").read_text(encoding="utf-8") == "precious"


def test_file_instead_of_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ProjectError, match="is a file"):
        ProjectFolder.create(tmp_path / "file")


def test_unwritable_place_is_said_in_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(DiskError, match="Could not write"):
        ProjectFolder.create(tmp_path / "file" / "below")


def test_missing_project_is_said(tmp_path: Path) -> None:
    with pytest.raises(ProjectError, match=r"has no project\.json"):
        ProjectFolder.open_existing(tmp_path)


def test_damaged_project_file_is_said(tmp_path: Path) -> None:
    (tmp_path / "project.json").write_text("{half")
    with pytest.raises(FormatError, match="cannot be read"):
        ProjectFolder.open_existing(tmp_path)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("[]", "must be an object"),
        ("{}", "`version` is missing"),
        *(
            (
                f'{{"version": {number}, "stages": {{}}}}',
                f"format number {number}, and .* reads 1 only: update Gaussian",
            )
            for number in (0, 2, 99, -1)
        ),
        ('{"version": 1}', "`stages` is missing"),
        ('{"version": 1, "stages": {"photos": {"key": 3}}}', r"`stages\.photos\.key` must be a text"),
        (
            '{"version": 1, "stages": {}, "earlier_outputs": {"training": {"a": {}}}}',
            r"`earlier_outputs\.training\.a\.size` is missing",
        ),
    ],
)
def test_project_file_of_another_kind_is_said(content: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "project.json").write_text(content)
    with pytest.raises(FormatError, match=said):
        ProjectFolder.open_existing(tmp_path)


def done(project: ProjectFolder, stage: str, outputs: dict[str, bytes]) -> None:
    for name, content in outputs.items():
        (project.path / name).parent.mkdir(exist_ok=True)
        (project.path / name).write_bytes(content)
    project.finish_stage(
        stage, "key", wall_seconds=1, cpu_seconds=1, figures={}, outputs=[project.path / name for name in outputs]
    )


@pytest.mark.parametrize(("change", "said"), [(b"cut", "was damaged"), (b"SCENE", "was damaged"), (None, "is missing")])
def test_output_that_changed_since_it_was_recorded_is_named(change: bytes | None, said: str, tmp_path: Path) -> None:
    done(ProjectFolder.create(tmp_path / "p"), "training", {"gaussians/scene.ply": b"scene", "gaussians/b.npy": b"b"})
    project = ProjectFolder.open_existing(tmp_path / "p")
    project.require_intact("training", "cameras")
    file = tmp_path / "p" / "gaussians" / "scene.ply"
    if change is None:
        file.unlink()
    else:
        file.write_bytes(change)
    assert project.damaged_outputs("training") == {"gaussians/scene.ply": said}
    with pytest.raises(FormatError, match=rf"scene\.ply {said}\. Run `reconstruct` again"):
        project.require_intact("training")


def test_outputs_that_are_being_made_anew_are_not_used_and_their_hashes_are_kept(tmp_path: Path) -> None:
    project = ProjectFolder.create(tmp_path / "p")
    done(project, "training", {"gaussians/scene.ply": b"scene"})
    recorded = project.recorded_outputs("training")
    assert recorded["gaussians/scene.ply"]["size"] == 5
    project.forget_stages(["training"])
    again = ProjectFolder.open_existing(tmp_path / "p")
    assert again.stage_record("training") is None and again.recorded_outputs("training") == recorded
    with pytest.raises(ProjectError, match="'training' of .* is not finished. Run `reconstruct` again"):
        again.require_intact("training")
    done(again, "training", {"gaussians/scene.ply": b"other"})
    again.require_intact("training")


def test_recorded_name_that_leads_out_of_the_project_is_refused(tmp_path: Path) -> None:
    project = ProjectFolder.create(tmp_path / "p")
    done(project, "training", {"gaussians/scene.ply": b"scene"})
    text = (tmp_path / "p" / "project.json").read_text(encoding="utf-8").replace("gaussians/scene.ply", "../secret")
    (tmp_path / "p" / "project.json").write_text(text)
    with pytest.raises(FormatError, match="leads out of the folder"):
        ProjectFolder.open_existing(tmp_path / "p").require_intact("training")


def test_trash_of_a_project_is_not_a_foreign_file(tmp_path: Path) -> None:
    (tmp_path / "trash").mkdir()
    ProjectFolder.create(tmp_path)


def test_stage_counts_as_done_only_with_its_key(tmp_path: Path) -> None:
    project = ProjectFolder.create(tmp_path / "p")
    project.finish_stage("photos", stage_key("a"), wall_seconds=1.0, cpu_seconds=1.0, figures={"n_photos": 3})
    again = ProjectFolder.open_existing(tmp_path / "p")
    assert again.stage_is_done("photos", stage_key("a"))
    assert not again.stage_is_done("photos", stage_key("b"))
    again.forget_stages(["photos"])
    assert not ProjectFolder.open_existing(tmp_path / "p").stage_is_done("photos", stage_key("a"))


def test_second_job_on_one_folder_is_refused(tmp_path: Path) -> None:
    first, second = ProjectFolder.create(tmp_path / "p"), ProjectFolder.create(tmp_path / "p")
    with first, pytest.raises(ProjectError, match="Another job is working"), second:
        pass
    with second:
        pass


def test_job_of_another_computer_on_a_shared_disk_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = ProjectFolder.create(tmp_path / "p"), ProjectFolder.create(tmp_path / "p")
    here = socket.gethostname()
    monkeypatch.setattr(socket, "gethostname", lambda: "photo-studio")
    with first:
        monkeypatch.setattr(socket, "gethostname", lambda: here)
        with pytest.raises(ProjectInUse, match=r"is working in .* on the computer photo-studio\."), second:
            pass
    # The name that a finished or killed job leaves holds nobody up, and is replaced.
    with second, pytest.raises(ProjectInUse) as caught, first:
        pass
    assert "on the computer" not in str(caught.value)


def test_name_in_a_lock_of_someone_else_moves_no_cursor(tmp_path: Path) -> None:
    first, second = ProjectFolder.create(tmp_path / "p"), ProjectFolder.create(tmp_path / "p")
    with first:
        (tmp_path / "p" / "lock").write_text("\x1b[2Jstudio" * 100 + " 1\n")
        with pytest.raises(ProjectInUse) as caught, second:
            pass
    assert "\x1b" not in str(caught.value) and len(str(caught.value)) < len(str(tmp_path)) + 1000


def test_file_that_a_lock_of_someone_else_is_linked_to_keeps_its_content(tmp_path: Path) -> None:
    mine = tmp_path / "mine.txt"
    mine.write_text("mine")
    project = ProjectFolder.create(tmp_path / "p")
    os.link(mine, tmp_path / "p" / "lock")
    with project:
        pass
    assert mine.read_text(encoding="utf-8") == "mine"


def test_disk_without_locks_is_told_instead_of_a_job_that_does_not_exist(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_locks(stream: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    project = ProjectFolder.create(tmp_path / "p")
    monkeypatch.setattr("engine.core.system.locks._lock", no_locks)
    with pytest.raises(DiskError, match="No locks available"), project:
        pass


def test_killed_job_frees_its_lock_and_its_leftovers_are_cleared(tmp_path: Path) -> None:
    folder = tmp_path / "p"
    script = (
        "import os, sys; from pathlib import Path\n"
        "from engine.core.files import atomic_write; from engine.project.folder import ProjectFolder\n"
        "folder = Path(sys.argv[1])\n"
        "with ProjectFolder.create(folder), atomic_write(folder / 'masks' / 'a.npz') as stream:\n"
        "    stream.write(b'half'); stream.flush(); os.kill(os.getpid(), 9)\n"
    )
    subprocess.run([sys.executable, "-c", script, str(folder)], cwd=Path(__file__).parents[3], check=False)
    assert len(list((folder / "masks").iterdir())) == 1
    with ProjectFolder.create(folder):
        assert list((folder / "masks").iterdir()) == []


def test_job_that_waited_sees_what_the_one_before_it_finished(tmp_path: Path) -> None:
    first, second = ProjectFolder.create(tmp_path / "p"), ProjectFolder.create(tmp_path / "p")
    with first:
        first.finish_stage("photos", "key", wall_seconds=1.0, cpu_seconds=1.0, figures={})
    with second:
        second.put("engine_version", "1")
    assert ProjectFolder.open_existing(tmp_path / "p").stage_is_done("photos", "key")


def test_numbers_that_json_does_not_know_are_never_written(tmp_path: Path) -> None:
    write_json(tmp_path / "a.json", {"old": 1})
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(tmp_path / "a.json", {"error": float("nan")})
    assert json.loads((tmp_path / "a.json").read_text(encoding="utf-8")) == {"old": 1}
    assert finite_or_null({"a": [float("inf"), 1.5], "b": (float("nan"),)}) == {"a": [None, 1.5], "b": [None]}


@pytest.mark.parametrize("number", [2, 0])
def test_project_of_another_number_is_refused_by_commands_and_where_its_scene_is_shown(
    number: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Blender and the page show the scene that `scene_file` names; a batch runs `reconstruct`."""
    path = write_finished_project(tmp_path)
    stored = json.loads((path / "project.json").read_text(encoding="utf-8"))
    write_json(path / "project.json", {**stored, "version": number})
    said = f"has the format number {number}, and this version of Gaussian Heritage reads 1 only: update"
    photos = tmp_path / "photos"
    for command in (
        ["export", path, "--format", "ply", "--out", tmp_path / "a.ply"],
        ["reconstruct", photos, "--out", path],
    ):
        answer = call(capsys, *command)
        assert answer.code != 0 and said in answer.error and "use a new folder for the scene." in answer.error
    with pytest.raises(FormatError, match=said):
        scene_file(path)
