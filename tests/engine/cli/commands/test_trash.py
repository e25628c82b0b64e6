"""`trash`: what was deleted or replaced is listed, restored, and deleted for good only when asked for."""

from __future__ import annotations

from pathlib import Path

import pytest

from engine.project.objects import list_objects
from tests.engine.command_line import call
from tests.engine.finished_project import write_finished_project


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    return write_finished_project(tmp_path)


def test_replaced_background_is_listed_restored_and_deleted(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (message,) = call(capsys, "trash", "list", scene).of_kind("finished")
    assert message["message"] == "The trash is empty."
    for _ in range(3):
        assert call(capsys, "segment", scene, "--complement").code == 0
    (answer,) = call(capsys, "trash", "list", scene).of_kind("finished")
    first, second = answer["message"].splitlines()
    assert first.startswith("1: background (replaced by a new background, ") and second.startswith("2: background (")
    assert answer["outputs"]["trash"][1] == {"number": 2, "id": "background", "name": "background"}
    (answer,) = call(capsys, "trash", "restore", scene, "2").of_kind("finished")
    assert answer["outputs"] == {"objects": ["background-2"]}
    assert {record.name for record in list_objects(scene)} == {"box", "teapot", "background", "background-2"}
    assert call(capsys, "report", scene).code == 0
    (answer,) = call(capsys, "trash", "empty", scene, "--older-than", "1").of_kind("finished")
    assert answer["message"] == "Deleted 0 objects for good, 0.0 MB."
    (answer,) = call(capsys, "trash", "empty", scene).of_kind("finished")
    assert answer["message"].startswith("Deleted 1 object for good") and answer["outputs"]["n_bytes"] > 1000
    assert call(capsys, "trash", "list", scene).of_kind("finished")[0]["outputs"] == {"trash": []}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["restore", "SCENE"], "requires the number or the name"),
        (["list", "SCENE", "vase"], "the others take none"),
        (["empty", "SCENE", "vase"], "the others take none"),
        (["list", "SCENE", "--older-than", "1"], "only be used with `trash empty`"),
        (["empty", "SCENE", "--older-than", "-1"], "must be 0 to"),
        (["empty", "SCENE", "--older-than", "1e300"], "must be 0 to"),
        (["empty", "SCENE", "--older-than", "nan"], "must be 0 to"),
        (["restore", "SCENE", "vase"], "The trash has no 'vase'. It holds: nothing."),
    ],
)
def test_unusable_arguments_are_a_sentence(
    arguments: list[str], said: str, scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = call(capsys, "trash", *(scene if word == "SCENE" else word for word in arguments))
    assert said in answer.error
