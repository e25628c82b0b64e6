"""The detector shared by the tests of grounding, and a photo of the museum room with its true segments."""

from __future__ import annotations

import json
from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from engine.objects.grounding.offline_vocabulary import OfflineVocabulary
from engine.objects.grounding.sentences import SentenceEncoder
from tests.conftest import ROOT
from tests.engine.install.models.weights import fetched

ROOM = ROOT / "demo" / "museum_room"


@dataclass(frozen=True)
class Room:
    """A photo, its label map, and prompt to id for each exhibit."""

    pixels: NDArray[np.uint8]
    labels: NDArray[np.int32]
    ids: dict[str, int]


@pytest.fixture(scope="session")
def detector() -> OfflineVocabulary:
    """Return the real model with its downloaded weights."""
    fetched("efficientnet-lite2", "minilm", "minilm-tokenizer")
    return OfflineVocabulary()


@pytest.fixture(scope="session")
def encoder() -> SentenceEncoder:
    """Return the real model with its downloaded weights."""
    return SentenceEncoder(*fetched("minilm", "minilm-tokenizer"))


@pytest.fixture(scope="session")
def room() -> Room:
    """Return a photo of the museum room in which most exhibits are completely visible."""
    pixels = cv2.cvtColor(cv2.imread(str(ROOM / "photos" / "view_20.jpg")), cv2.COLOR_BGR2RGB)
    labels = cv2.imread(str(ROOM / "truth" / "masks" / "view_20.png"), cv2.IMREAD_UNCHANGED)
    names = json.loads((ROOM / "truth" / "names.json").read_text(encoding="utf-8"))
    return Room(pixels, labels.astype(np.int32), {entry["prompt"]: int(i) for i, entry in names.items()})
