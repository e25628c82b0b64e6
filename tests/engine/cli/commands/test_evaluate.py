"""`evaluate`: one command from a project and true masks to a table; the project stays as it was."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.engine.command_line import call
from tests.engine.objects.fakes import FakeDetector, FakeSam, trained_project
from tests.engine.pictures.blob_scene import BLUE, BlobScene
from tests.engine.quality.evaluation.blob_truth import held_out, write_truth


@pytest.fixture
def scene(blobs: BlobScene, tmp_path: Path) -> Path:
    write_truth(blobs, tmp_path / "truth", names={BLUE: "blue ball"})
    return held_out(trained_project(blobs, tmp_path)).path


def test_table_is_told_and_written_and_the_project_untouched(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def content() -> dict[Path, bytes]:
        return {path: path.read_bytes() for path in scene.rglob("*") if path.is_file()}

    before, doc = content(), tmp_path / "table.md"
    asked = ("--view-counts", "2", "--objects", "blue ball", "--doc", doc)
    answer = call(capsys, "evaluate", scene, tmp_path / "truth", *asked)
    (finished,) = answer.of_kind("finished")
    assert answer.code == 0 and finished["outputs"] == {"table": str(doc)}
    for line in (
        "| mean of 1 objects | found | IoU",
        "| paper | 1 of 1 |",
        "| better, 2 views | 1 of 1 |",
        "| object | views | paper | better |",
        "| blue ball | 2 | ",
    ):
        assert line in finished["message"] and line in doc.read_text(encoding="utf-8")
    command = (
        f"evaluate {tmp_path.name}/project {tmp_path.name}/truth --presets paper,better --prompt-kind mask"
        " --views held-out"
    )
    assert f"{command} --view-counts 2 --objects 'blue ball' --doc table.md" in doc.read_text(encoding="utf-8")
    assert content() == before


def test_document_tells_the_command_as_it_was_given(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    asked = ("--presets", "paper", "--objects", "blue ball", "--doc", "docs/table.md")
    assert call(capsys, "evaluate", "project", "truth", *asked).code == 0
    text = (tmp_path / "docs" / "table.md").read_text(encoding="utf-8")
    assert "engine evaluate project truth --presets paper " in text and "--doc docs/table.md" in text


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (("--presets", "best"), "presets"),
        (("--objects", "ghost"), "no true masks of 'ghost'"),
        (("--layout", "3d-ovs"), r"classes.txt is missing"),
        (("--doc", "."), "is a folder"),
        (("--results", "."), "is a folder"),
        (("--prompt-kind", "all", "--presets", "paper"), "with better among them to find all objects"),
        (("--view-counts", "few"), "--view-counts 'few' is not a list of numbers"),
    ],
)
def test_what_cannot_be_compared_is_said_in_a_sentence(
    wrong: tuple[str, str], told: str, scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert told in call(capsys, "evaluate", scene, tmp_path / "truth", *wrong).error


def test_the_chosen_segment_anything_answers_and_is_named_in_the_document(
    scene: Path,
    blobs: BlobScene,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked_for: list[str] = []

    def load(name: str) -> FakeSam:
        asked_for.append(name)
        return FakeSam(blobs)

    monkeypatch.setattr("engine.masks.sam.load_sam", load)
    asked = ("--sam", "mobile-sam", "--prompt-kind", "click", "--objects", "blue ball", "--doc", tmp_path / "table.md")
    assert call(capsys, "evaluate", scene, tmp_path / "truth", *asked).code == 0
    assert set(asked_for) == {"mobile-sam"}
    table = (tmp_path / "table.md").read_text(encoding="utf-8")
    assert "--prompt-kind click --views held-out --sam mobile-sam" in table


@pytest.mark.parametrize("kind", ["text", "mask", "click", "all"])
def test_every_kind_of_prompt_writes_its_results(
    kind: str,
    scene: Path,
    blobs: BlobScene,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("engine.masks.sam.load_default_sam", lambda: FakeSam(blobs))
    monkeypatch.setattr("engine.objects.grounding.default.load_default_detector", lambda: FakeDetector(blobs))
    file, doc = tmp_path / "results.json", tmp_path / "table.md"
    asked = ("--prompt-kind", kind, "--presets", "better", "--results", file, "--doc", doc)
    answer = call(capsys, "evaluate", scene, tmp_path / "truth", *asked)
    assert answer.code == 0, answer.events
    (finished,) = answer.of_kind("finished")
    assert finished["outputs"] == {"table": str(doc), "results": str(file)}
    (figures,) = json.loads(file.read_text(encoding="utf-8"))["summary"]
    assert (figures["n_found"], figures["n_asked"]) == (1, 1) and figures["iou"] > 0.9
    assert f"{100 * figures['iou']:.1f}" in doc.read_text(encoding="utf-8")
