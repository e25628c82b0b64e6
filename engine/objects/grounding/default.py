"""The default text detector."""

from __future__ import annotations

import functools
import logging
from pathlib import Path

from ...core.errors import ModelFileError
from ...install.models import ANY_WORD_MODEL, find_model_file, find_model_files, locate, models_folder, open_session
from .detector import Detector
from .image_text import ENCODERS

_LOG = logging.getLogger(__name__)
# In order of preference, after the encoders; the paper uses the base model.
_GROUNDING_DINO_NAMES = ("grounding-dino-base", "grounding-dino-tiny")
_OFFLINE_NAME = "offline-vocabulary"
WORD_MODELS = (*ENCODERS, *_GROUNDING_DINO_NAMES, _OFFLINE_NAME)
"""Models of the catalogue that answer words, the first that is stored before the others."""


def default_detector_name() -> str:
    """Return the catalogue's name of the detector that `load_default_detector` loads.

    An image-text encoder whose files are all in the models folder, otherwise a Grounding DINO whose file is there,
    otherwise the offline vocabulary, whose weights are available without a model hub. Files are not verified here. A
    damaged file raises an error when it is loaded; another detector is never used in its place.
    """
    if (best := stored_describers()[0]) != _OFFLINE_NAME:
        return best
    for name in _GROUNDING_DINO_NAMES:
        if (models_folder() / find_model_file(f"{name}-model").file).exists():
            return name
    return _OFFLINE_NAME


def stored_describers() -> list[str]:
    """Return the names of the detectors that describe crops and whose files are in the models folder, the best first.

    The offline vocabulary is always the last one: the set-up fetches it.
    """
    folder = models_folder()
    stored = [name for name in ENCODERS if all((folder / file.file).exists() for file in find_model_files(name))]
    return [*stored, _OFFLINE_NAME]


def offered_model(detector: str) -> str:
    """Return the model to offer where `detector` does not know or find a word; empty where it knows all words."""
    return ANY_WORD_MODEL if detector == _OFFLINE_NAME else ""


def load_default_detector() -> Detector:
    """Return the detector of `default_detector_name`; see `load_detector`."""
    return load_detector(default_detector_name())


def load_detector(name: str) -> Detector:
    """Return the detector that the catalogue calls `name`.

    There is one instance per process, which caches its results for a photo across prompts. Its ``name`` is stored with
    the objects that it finds.

    Raises
    ------
    ModelFileError
        When there is no such one, or one of its files is missing or damaged; the message then contains the command that
        fetches it.
    """
    if name not in WORD_MODELS:
        raise ModelFileError(f"There is no model for words called {name!r}. Known: {', '.join(WORD_MODELS)}.")
    return _load(name, models_folder().parent)


@functools.cache
def _load(name: str, cache: Path) -> Detector:
    _LOG.info("Text detector: %s", name)
    if name == _OFFLINE_NAME:
        from .offline_vocabulary import OfflineVocabulary

        return OfflineVocabulary(cache)
    if name in ENCODERS:
        from .any_word import AnyWord
        from .image_text import load_encoder
        from .offline_vocabulary import OfflineVocabulary

        return AnyWord(load_encoder(name, cache), OfflineVocabulary(cache), cache / "derived")
    from .grounding_dino import GroundingDino

    session = open_session(locate(f"{name}-model", cache))
    return GroundingDino(name, session, locate("grounding-dino-tokenizer", cache))
