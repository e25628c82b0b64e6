"""The folder of weight files on this computer; nothing here uses the network.

The files are stored in ``<cache>/models/``. ``<cache>`` is an argument, otherwise the environment variable
``GAUSSIAN_HERITAGE_CACHE``, otherwise the user's cache folder.
"""

from __future__ import annotations

import os
from pathlib import Path

from ...core.errors import ModelFileError
from .catalogue import find_model_file
from .verification import find_problem

CACHE_VARIABLE = "GAUSSIAN_HERITAGE_CACHE"
"""Environment variable that names the cache folder."""

OFFLINE_VARIABLE = "GAUSSIAN_HERITAGE_OFFLINE"
"""Environment variable that names a folder with weight files, or packages of them, that were copied there by hand."""


def models_folder(cache: Path | None = None) -> Path:
    """Return the folder of the weight files; it need not exist yet.

    Parameters
    ----------
    cache : Path or None
        The cache folder; None takes ``GAUSSIAN_HERITAGE_CACHE``, otherwise the user's cache folder.
    """
    if cache is None:
        configured = os.environ.get(CACHE_VARIABLE)
        if configured:
            cache = Path(configured)
        else:
            from platformdirs import user_cache_dir

            cache = Path(user_cache_dir("gaussian-heritage", appauthor=False))
    return cache / "models"


def locate(name: str, cache: Path | None = None) -> Path:
    """Return the path of a stored weight file after verifying its SHA-256 (`verification.find_problem`).

    Parameters
    ----------
    name : str
        Name in `CATALOGUE`.
    cache : Path or None
        See `models_folder`.

    Raises
    ------
    ModelFileError
        When the file is missing or damaged; the message contains the command that fetches it.
    FormatError
        When the record of the first use cannot be read.
    """
    model = find_model_file(name)
    path = models_folder(cache) / model.file
    problem = find_problem(model, path)
    if problem is not None:
        raise ModelFileError(f"The model file {path} {problem}. Run: python -m engine models fetch {name}")
    return path
