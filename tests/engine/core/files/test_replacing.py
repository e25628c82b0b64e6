"""Files that belong together are all old or all new, whenever the process is killed."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from engine.core.errors import DiskError
from engine.core.files import finish_replacements, replace_together

OLD = {"a.npy": "old a", "b.npy": "old b", "set.json": "old set", "notes.txt": "mine"}
NEW = {"a.npy": "new a", "set.json": "new set", "notes.txt": "mine"}


class Killed(BaseException):
    """What kill -9 does: nothing that runs after it."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "project" / "set"
    made.mkdir(parents=True)
    for name, text in OLD.items():
        (made / name).write_text(text)
    return made


def write(folder: Path) -> None:
    with replace_together(folder, optional=("a.npy", "b.npy")) as new:
        (new / "a.npy").write_text("new a")
        (new / "set.json").write_text("new set")


def contents(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text(encoding="utf-8") for path in folder.iterdir() if path.is_file()}


def killed_at(number: int, patch: pytest.MonkeyPatch) -> None:
    """Let the process die at the given rename or deletion."""
    count = 0

    def counted(function: Callable[..., object]) -> Callable[..., object]:
        def call(*arguments: object, **options: object) -> object:
            nonlocal count
            count += 1
            if count > number:
                raise Killed
            return function(*arguments, **options)

        return call

    patch.setattr(os, "replace", counted(os.replace))
    patch.setattr(Path, "unlink", counted(Path.unlink))


def test_files_are_replaced_and_what_is_not_written_is_deleted(folder: Path) -> None:
    write(folder)
    assert contents(folder) == NEW
    assert sorted(path.name for path in folder.iterdir()) == sorted(NEW)


def test_kill_at_every_rename_and_deletion_leaves_the_old_or_the_new_files(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    outcomes = []
    for number in range(20):
        for name, text in OLD.items():
            (folder / name).write_text(text)
        with monkeypatch.context() as patch:
            killed_at(number, patch)
            try:
                write(folder)
                break
            except Killed:
                pass
        between = contents(folder)
        # Never files of both, also for a reader that does not wait for the next run.
        assert len({text.split()[0] for text in between.values()} - {"mine"}) <= 1
        finish_replacements(folder.parent)
        outcomes.append(contents(folder))
        assert outcomes[-1] in (OLD, NEW)
    assert OLD in outcomes and NEW in outcomes and len(outcomes) > 4


def test_error_in_the_block_leaves_the_files_as_they_were(folder: Path) -> None:
    with pytest.raises(ValueError, match="mine"), replace_together(folder) as new:
        (new / "a.npy").write_text("new a")
        raise ValueError("mine")
    assert contents(folder) == OLD
    assert sorted(path.name for path in folder.iterdir()) == sorted(OLD)


def test_full_disk_is_said(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(DiskError, match="No space left"):
        write(folder)
    assert contents(folder) == OLD
