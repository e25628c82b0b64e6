"""The default detector: Grounding DINO if it is in the models folder; never another one in place of a damaged file."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from engine.core.errors import ModelFileError
from engine.core.files import file_sha256
from engine.install.models.cache import CACHE_VARIABLE
from engine.install.models.catalogue import find_model_file
from engine.install.models.verification import write_record
from engine.objects.grounding import any_word, image_text, offline_vocabulary
from engine.objects.grounding.default import default_detector_name, load_default_detector
from engine.objects.grounding.grounding_dino import GroundingDino
from tests.engine.objects.grounding import tiny_dino


@pytest.fixture
def models(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    (tmp_path / "models").mkdir()
    return tmp_path / "models"


def _trust(path: Path, name: str) -> None:
    write_record(path, find_model_file(name), path.stat().st_size, file_sha256(path))


def test_offline_vocabulary_is_the_default_without_grounding_dino(
    models: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (models / "grounding-dino-tiny.onnx.part").write_bytes(b"a partial download")
    assert default_detector_name() == "offline-vocabulary"
    opened: list[Path] = []
    monkeypatch.setattr(offline_vocabulary, "OfflineVocabulary", lambda cache: opened.append(cache) or "it")
    with caplog.at_level(logging.INFO):
        assert load_default_detector() == "it" and load_default_detector() == "it"
    assert opened == [models.parent]  # one instance per process
    assert [record.getMessage() for record in caplog.records] == ["Text detector: offline-vocabulary"]


def test_grounding_dino_is_the_default_if_its_files_are_stored(models: Path) -> None:
    tiny_dino.tokenizer(models)
    (models / "tokenizer.json").rename(models / "grounding-dino-tokenizer.json")
    (models / "grounding-dino-tiny.onnx").write_bytes(tiny_dino.exported())
    with pytest.raises(ModelFileError, match="copied here by hand"):
        load_default_detector()
    _trust(models / "grounding-dino-tiny.onnx", "grounding-dino-tiny-model")
    _trust(models / "grounding-dino-tokenizer.json", "grounding-dino-tokenizer")
    detector = load_default_detector()
    assert isinstance(detector, GroundingDino) and detector.name == "grounding-dino-tiny"
    (models / "grounding-dino-base.onnx").write_bytes(b"the larger one is preferred")
    assert default_detector_name() == "grounding-dino-base"


def test_image_text_encoder_is_preferred_once_all_its_files_are_stored(
    models: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (models / "grounding-dino-tiny.onnx").write_bytes(b"fetched before")
    for name in ("clip-vit-b-32-vision.onnx", "clip-vit-b-32-text.onnx"):
        (models / name).write_bytes(b"one of three files")
        assert default_detector_name() == "grounding-dino-tiny"
    (models / "clip-vit-b-32-tokenizer.json").write_bytes(b"the third")
    assert default_detector_name() == "clip-vit-b-32"
    with pytest.raises(ModelFileError, match="vision.onnx is damaged .* models fetch clip-vit-b-32-vision"):
        load_default_detector()
    opened: list[tuple[str, Path]] = []
    monkeypatch.setattr(image_text, "load_encoder", lambda name, cache: opened.append((name, cache)))
    monkeypatch.setattr(offline_vocabulary, "OfflineVocabulary", lambda cache: None)
    monkeypatch.setattr(any_word, "AnyWord", lambda encoder, classifier, derived: "it")
    assert load_default_detector() == "it" and opened == [("clip-vit-b-32", models.parent)]


def test_damaged_or_incomplete_grounding_dino_raises_instead_of_using_another_detector(models: Path) -> None:
    path = models / "grounding-dino-tiny.onnx"
    path.write_bytes(b"not an ONNX file")
    _trust(path, "grounding-dino-tiny-model")
    with pytest.raises(ModelFileError, match="cannot be opened"):
        load_default_detector()
    path.write_bytes(b"cut")
    with pytest.raises(ModelFileError, match="is damaged .* models fetch grounding-dino-tiny-model"):
        load_default_detector()
