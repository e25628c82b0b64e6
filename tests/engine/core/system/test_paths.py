"""Before files are put into a folder it is known whether their longest path fits."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path, PurePath

import pytest

from engine.core.system import engine_folder, paths, takes_path

LONGEST = PurePath("Lib/site-packages/torch.dist-info/licenses/third_party/" + "x" * 90 + "/LICENSE")


@pytest.fixture
def limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Limit paths to a number of characters, as Windows does; tests have longer folders there than users."""
    real, most = Path.touch, len(str(tmp_path / LONGEST)) + 20

    def touch(path: Path, *arguments: object) -> None:
        if len(str(path)) > most:
            raise FileNotFoundError(2, "The system cannot find the path specified", str(path))
        real(path)

    monkeypatch.setattr(Path, "touch", touch)
    yield most


def folder_of(length: int, parent: Path) -> Path:
    return parent / ("x" * (length - len(str(parent)) - 1))


@pytest.mark.parametrize(("over", "fits"), [(0, True), (1, False)])
def test_longest_path_decides(over: int, fits: bool, limit: int, tmp_path: Path) -> None:
    folder = folder_of(limit + over - len(str(LONGEST)) - 1, tmp_path)
    assert takes_path(folder, LONGEST) is fits
    assert list(folder.iterdir()) == []


def test_short_and_very_long_paths_are_tried_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[int] = []
    monkeypatch.setattr(Path, "touch", lambda path: tried.append(len(str(path.relative_to(tmp_path)))))
    for length in (60, 150, 700):
        assert takes_path(tmp_path, PurePath("x" * (length - 8) + "/LICENSE"))
    assert tried == [60, 150, 700]


def test_user_with_a_long_name_has_room_for_the_longest_package(monkeypatch: pytest.MonkeyPatch) -> None:
    """Names of accounts on Windows have up to 20 characters; a domain may add ``.DOMAIN``."""
    monkeypatch.setattr(paths.sys, "platform", "win32")
    monkeypatch.setenv("LOCALAPPDATA", "C:/Users/" + "x" * 36 + "/AppData/Local")
    from engine.install.environment import installer

    longest = engine_folder() / "env" / installer.LONGEST_PATH
    assert len(str(longest)) <= 259
