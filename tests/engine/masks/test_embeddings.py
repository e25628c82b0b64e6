"""A photo is encoded only once; damaged files are computed again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from engine.masks import embeddings
from engine.masks.embeddings import EmbeddingFolder
from engine.masks.sam import Embedding
from engine.masks.settings import EMBEDDING_BYTES

PIXELS = np.random.default_rng(0).integers(0, 256, (48, 64, 3), np.uint8)


class _Counting:
    """A SAM that counts what it encodes."""

    def __init__(self, name: str = "one") -> None:
        self.name, self.encoded = name, 0

    def encode(self, pixels: np.ndarray) -> Embedding:
        self.encoded += 1
        features = np.random.default_rng(int(pixels.sum())).normal(size=(1, 256, 64, 64)).astype(np.float32)
        return Embedding(features, *pixels.shape[:2], 16.0)


def _encode(folder: Path, sam: _Counting, photo: str = "hall/a.jpg", pixels: np.ndarray = PIXELS) -> Embedding:
    return EmbeddingFolder(folder).encode(photo, pixels, sam)  # type: ignore[arg-type]


def test_second_process_gets_the_same_values_without_encoding(tmp_path: Path) -> None:
    sam = _Counting()
    first, second = _encode(tmp_path, sam), _encode(tmp_path, sam)
    assert sam.encoded == 1
    np.testing.assert_array_equal(first.features, second.features)
    assert (first.height, first.width, first.scale) == (second.height, second.width, second.scale) == (48, 64, 16.0)
    # Half precision has 11 bits.
    np.testing.assert_allclose(first.features, sam.encode(PIXELS).features, rtol=2**-11, atol=1e-6)
    assert EMBEDDING_BYTES <= (tmp_path / "hall" / "a.jpg.sam.npz").stat().st_size < EMBEDDING_BYTES + 2000


def test_another_photo_of_the_same_name_or_another_sam_is_encoded_again(tmp_path: Path) -> None:
    sam, other = _Counting(), _Counting("other")
    _encode(tmp_path, sam)
    _encode(tmp_path, sam, pixels=PIXELS[::-1])
    assert sam.encoded == 2
    _encode(tmp_path, other, pixels=PIXELS[::-1])
    assert other.encoded == 1


@pytest.mark.parametrize("damage", [b"", b"half", None])
def test_damaged_file_is_computed_again(tmp_path: Path, damage: bytes | None) -> None:
    sam = _Counting()
    _encode(tmp_path, sam)
    file = tmp_path / "hall" / "a.jpg.sam.npz"
    file.write_bytes(file.read_bytes()[:-900] if damage is None else damage)
    _encode(tmp_path, sam)
    _encode(tmp_path, sam)
    assert sam.encoded == 2


def test_flipped_bits_are_noticed(tmp_path: Path) -> None:
    sam = _Counting()
    whole = _encode(tmp_path, sam)
    file = tmp_path / "hall" / "a.jpg.sam.npz"
    content = bytearray(file.read_bytes())
    content[EMBEDDING_BYTES // 2] ^= 0xFF
    file.write_bytes(content)
    np.testing.assert_array_equal(_encode(tmp_path, sam).features, whole.features)
    assert sam.encoded == 2


def test_folder_has_a_maximum_size_and_results_stay_correct(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(embeddings, "MAX_EMBEDDINGS", 2)
    sam = _Counting()
    for name in ("a.jpg", "b.jpg", "c.jpg", "c.jpg"):
        _encode(tmp_path, sam, name)
    assert sam.encoded == 4
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.jpg.sam.npz", "b.jpg.sam.npz"]
    _encode(tmp_path, sam, "a.jpg", PIXELS[::-1])
    _encode(tmp_path, sam, "a.jpg", PIXELS[::-1])
    assert sam.encoded == 5


def test_disk_that_cannot_be_written_costs_only_time(tmp_path: Path) -> None:
    (tmp_path / "hall").write_text("a file where the folder should be")
    sam = _Counting()
    assert _encode(tmp_path, sam).width == 64
    assert sam.encoded == 1


def test_copy_holds_what_was_stored_of_the_named_photos_and_leaves_the_original(tmp_path: Path) -> None:
    sam = _Counting()
    stored = EmbeddingFolder(tmp_path / "stored")
    for photo in ("hall/a.jpg", "b.jpg"):
        stored.encode(photo, PIXELS, sam)  # type: ignore[arg-type]
    before = sorted(path for path in (tmp_path / "stored").rglob("*") if path.is_file())
    copied = stored.copied(tmp_path / "copy", ["hall/a.jpg", "c.jpg"])
    copied.encode("hall/a.jpg", PIXELS, sam)  # type: ignore[arg-type]
    assert sam.encoded == 2
    copied.encode("b.jpg", PIXELS, sam)  # type: ignore[arg-type]
    copied.encode("c.jpg", PIXELS, sam)  # type: ignore[arg-type]
    assert sam.encoded == 4
    assert sorted(path for path in (tmp_path / "stored").rglob("*") if path.is_file()) == before
