"""A room is drawn again from what its folder says, or refused where the scripts would build another one."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.rooms.drawn import drawn_from
from engine.core.errors import FormatError, SettingsError


def test_a_room_of_models_is_not_drawn_again_with_our_own_exhibits(tmp_path: Path) -> None:
    (tmp_path / "truth").mkdir()
    file = tmp_path / "truth" / "room.json"
    for text in ('{"seed": 3, "attempt": 2}', '{"seed": 3, "attempt": 2, "exhibits": "own"}'):
        file.write_text(text, encoding="utf-8")
        assert drawn_from(tmp_path) == ["--seed", "3", "--attempt", "2"]
    file.write_text('{"seed": 3, "attempt": 2, "exhibits": "models"}', encoding="utf-8")
    with pytest.raises(SettingsError, match="shows 3D models of other people"):
        drawn_from(tmp_path)
    file.write_text("[]", encoding="utf-8")
    with pytest.raises(FormatError):
        drawn_from(tmp_path)
