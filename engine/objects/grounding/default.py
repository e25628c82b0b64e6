"""The default text detector."""

from __future__ import annotations

import functools
import logging
from pathlib import Path

from ...install.models import find_model_file, models_folder
from .detector import Detector

__all__ = ["default_detector_name", "load_default_detector"]

_LOG = logging.getLogger(__name__)
# In order of preference; the paper uses the base model.
_GROUNDING_DINO_NAMES = ("grounding-dino-base", "grounding-dino-tiny")
_OFFLINE_NAME = "offline-vocabulary"


def default_detector_name() -> str:
    """Return the catalogue's name of the detector that `load_default_detector` loads.

    A Grounding DINO whose file is in the models folder, otherwise the offline vocabulary, whose weights are available
    without a model hub. The file is not verified here. A damaged file raises an error when it is loaded; another
    detector is never used in its place.
    """
    for name in _GROUNDING_DINO_NAMES:
        if (models_folder() / find_model_file(f"{name}-model").file).exists():
            return name
    return _OFFLINE_NAME


def load_default_detector() -> Detector:
    """Return the detector of `default_detector_name`.

    There is one instance per process, which caches its results for a photo across prompts. Its ``name`` is stored with
    the objects that it finds.

    Raises
    ------
    ModelFileError
        When one of its files is missing or damaged; the message contains the command that fetches it.
    """
    return _load(default_detector_name(), models_folder().parent)


@functools.cache
def _load(name: str, cache: Path) -> Detector:
    _LOG.info("Text detector: %s", name)
    if name == _OFFLINE_NAME:
        from .offline_vocabulary import OfflineVocabulary

        return OfflineVocabulary(cache)
    from .grounding_dino import GroundingDino

    return GroundingDino(name, cache)
