"""Which text detector answers when nothing else is chosen."""

from __future__ import annotations

import functools
import logging
from pathlib import Path

from ..models import find, models_folder
from .detector import Detector

__all__ = ["default_detector_name", "load_default_detector"]

_LOG = logging.getLogger(__name__)
# The best one first: the paper's is the base model.
_GROUNDING_DINO = ("grounding-dino-base", "grounding-dino-tiny")
_OFFLINE = "offline-vocabulary"


def default_detector_name() -> str:
    """Return the catalogue's name of the detector that `load_default_detector` opens.

    A Grounding DINO whose file lies in the models folder, else the offline vocabulary, whose weights can be had
    without a model hub. Whether the file is whole is not asked here: a damaged one is an error when it is opened, and
    never a reason to answer with another detector.
    """
    for name in _GROUNDING_DINO:
        if (models_folder() / find(f"{name}-model").file).exists():
            return name
    return _OFFLINE


def load_default_detector() -> Detector:
    """Return the detector of `default_detector_name`.

    One serves a whole process: it remembers what it saw in each photo from one prompt to the next. Its ``name`` goes
    into the objects it finds.

    Raises
    ------
    ModelFileError
        When one of its files is missing or damaged; the message holds the command that fetches it.
    """
    return _load(default_detector_name(), models_folder().parent)


@functools.cache
def _load(name: str, cache: Path) -> Detector:
    _LOG.info("Text detector: %s", name)
    if name == _OFFLINE:
        from .offline_vocabulary import OfflineVocabulary

        return OfflineVocabulary(cache)
    from .grounding_dino import GroundingDino

    return GroundingDino(name, cache)
