"""pip's own wheel, for a Python that brings no pip: it is the only file that is fetched without pip."""

from __future__ import annotations

import hashlib
import http.client
from pathlib import Path

from ...core.errors import EnvironmentProblem, HeritageError
from ...core.files import write_file
from ...core.https import open_https
from .locked import hashes_in, locked_file

_URL = (
    "https://files.pythonhosted.org/packages/70/7a/be4bd8bcbb24ea475856dd68159d78b03b2bb53dae369f69c9606b8888f5/"
    "pip-26.1-py3-none-any.whl"
)
_MAX_BYTES = 10_000_000


def fetch_pip(folder: Path) -> Path:
    """Download pip's wheel into `folder`, verify its SHA-256, and return the file.

    Raises
    ------
    EnvironmentProblem
        When it cannot be downloaded, or is another file.
    DiskError
        When `folder` cannot be written.
    """
    try:
        with open_https(_URL, {}) as response:
            content = response.read(_MAX_BYTES)
    except EnvironmentProblem:
        raise
    except (HeritageError, OSError, http.client.HTTPException, ValueError) as error:
        raise EnvironmentProblem(
            f"This Python brings no pip, and pip could not be downloaded ({error}). Check the network, or install "
            "Python's package for virtual environments (Debian: python3-venv)."
        ) from error
    if hashlib.sha256(content).hexdigest() not in hashes_in(locked_file("pip")):
        raise EnvironmentProblem(f"{_URL} is not the file that was expected, so it is not used. Try again later.")
    file = folder / _URL.rpartition("/")[2]
    write_file(file, content)
    return file
