"""Which text detector answers when nothing else is chosen."""

from __future__ import annotations

import functools

from .detector import Detector

__all__ = ["load_default_detector"]


@functools.cache
def load_default_detector() -> Detector:
    """Return the offline vocabulary, the text detector whose weights can be had without a model hub.

    One serves a whole process: it remembers what it saw in each photo from one prompt to the next.

    Raises
    ------
    ModelFileError
        When its weight files are missing; the message holds the command that fetches them.
    """
    from .offline_vocabulary import OfflineVocabulary

    return OfflineVocabulary()
