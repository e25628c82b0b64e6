"""The masks stage reuses the label maps of unchanged photos."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from engine.core.errors import Cancelled, MaskError
from engine.core.events import Event, Progress
from engine.core.files import file_sha256
from engine.masks import stage
from engine.masks.sam import Embedding
from engine.masks.settings import MaskSettings
from engine.masks.stage import make_masks
from engine.masks.storage import read_label_map
from engine.scene.photo import Photo, PhotoSet
from tests.engine.masks.shapes import shapes_picture

FEW_CLICKS = replace(MaskSettings(), max_prompts=2, max_side=128)
NAMES = ["a.png", "hall/b.png"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    picture = Image.fromarray(shapes_picture()[0])
    (tmp_path / "photos" / "hall").mkdir(parents=True)
    for name in NAMES:
        picture.save(tmp_path / "photos" / name)
    return tmp_path


def _photos(folder: Path) -> PhotoSet:
    photos = (Photo(name, 640, 480, None, file_sha256(folder / "photos" / name)) for name in NAMES)
    return PhotoSet(folder / "photos", tuple(photos), ())


class _Counting:
    """A SAM that counts the photos it encodes and predicts the same square for every click."""

    def __init__(self) -> None:
        self.encoded = 0
        self.name = "counting"
        self.device = "Photos are encoded by a test."

    def encode(self, pixels: np.ndarray) -> Embedding:
        self.encoded += 1
        height, width = pixels.shape[:2]
        return Embedding(np.zeros((1, 256, 64, 64), np.float32), height, width, 1024 / max(height, width))

    def predict_scales(
        self, embedding: Embedding, points: object, labels: object, *, without_padding: bool, min_stability: float
    ) -> list[tuple[np.ndarray, float]]:
        logits = np.full((256, 256), -9.0, np.float32)
        logits[60:120, 60:120] = 9.0
        return [(logits, 0.9)]


def _run(folder: Path, sam: _Counting, settings: MaskSettings = FEW_CLICKS, stop_after: int = 10**9) -> list[Event]:
    events: list[Event] = []
    paths = make_masks(
        _photos(folder),
        NAMES,
        folder / "masks",
        settings,
        lambda: sam,  # type: ignore[arg-type, return-value]
        emit=events.append,
        should_stop=lambda: sam.encoded >= stop_after,
    )
    assert list(paths) == NAMES
    assert all(read_label_map(path).shape == (96, 128) for path in paths.values())
    return events


def _n_computed(events: list[Event]) -> int:
    return sum(isinstance(event, Progress) and event.message.startswith("Segments of") for event in events)


def test_second_run_reuses_label_maps_until_a_photo_or_setting_changes(folder: Path) -> None:
    counting = _Counting()
    events = _run(folder, counting)
    assert _n_computed(events) == counting.encoded == 2
    assert [event.fraction for event in events if isinstance(event, Progress)] == [0.0, 0.0, 0.5, 1.0]
    assert any(isinstance(event, Progress) and event.message == counting.device for event in events)
    assert _n_computed(_run(folder, counting)) == 0
    Image.fromarray(shapes_picture(1)[0]).save(folder / "photos" / NAMES[0])
    assert _n_computed(_run(folder, counting)) == 1 and counting.encoded == 3
    assert _n_computed(_run(folder, counting, replace(FEW_CLICKS, min_iou=0.5))) == 2
    assert counting.encoded == 3  # the photos are the same


def test_cancelled_run_is_resumed_and_a_damaged_label_map_is_computed_again(folder: Path) -> None:
    counting = _Counting()
    with pytest.raises(Cancelled):
        _run(folder, counting, stop_after=1)
    assert _n_computed(_run(folder, counting)) == 2  # the first photo was stopped during its clicks
    assert counting.encoded == 2  # but after it was encoded
    (folder / "masks" / "a.png.npz").write_bytes(b"half")
    assert _n_computed(_run(folder, counting)) == 1 and counting.encoded == 2


def test_next_photo_is_encoded_beside_the_clicks_and_each_label_map_is_of_its_photo(folder: Path) -> None:
    class Telling(_Counting):
        """Predicts a square whose place depends on the photo."""

        def encode(self, pixels: np.ndarray) -> Embedding:
            found = super().encode(pixels)
            found.features[:] = pixels.mean() / 255
            return found

        def predict_scales(
            self, embedding: Embedding, points: object, labels: object, *, without_padding: bool, min_stability: float
        ) -> list[tuple[np.ndarray, float]]:
            logits = np.full((256, 256), -9.0, np.float32)
            start = int(100 * embedding.features.max())
            logits[start : start + 60, start : start + 60] = 9.0
            return [(logits, 0.9)]

    for shade, name in zip((64, 192), NAMES, strict=True):
        Image.new("RGB", (640, 480), (shade,) * 3).save(folder / "photos" / name)
    _run(folder, Telling())
    first, second = (read_label_map(folder / "masks" / f"{name}.npz") for name in NAMES)
    assert first[25, 25] > 0 and second[25, 25] == 0 and second[60, 60] > 0


def test_label_maps_of_another_method_are_never_mixed_with_new_ones(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    counting = _Counting()
    _run(folder, counting)
    monkeypatch.setattr(stage, "_METHOD_VERSION", stage._METHOD_VERSION + 1)
    assert _n_computed(_run(folder, counting)) == 2
    assert counting.encoded == 2  # embeddings do not depend on the clicks


def test_photo_that_is_not_in_the_set_is_rejected(folder: Path) -> None:
    with pytest.raises(MaskError, match="c.png is not a photo of .*photos"):
        make_masks(
            _photos(folder),
            ["c.png"],
            folder / "masks",
            FEW_CLICKS,
            _Counting,  # type: ignore[arg-type]
            emit=lambda event: None,
            should_stop=lambda: False,
        )
