"""Arrays in a file without a name: the system reads them when they are used, and takes back their memory."""

from __future__ import annotations

import math
import mmap
import tempfile
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .writing import TEMPORARY_PREFIX, write_problem


class ScratchFile(AbstractContextManager["ScratchFile"]):
    """A temporary file of arrays of bytes. It is gone with the last array of `arrays`, also when the process is killed.

    After the block, nothing can be added; the arrays stay.

    Parameters
    ----------
    folder : Path
        On a disk with room for them; created when missing.

    Raises
    ------
    DiskError
        When the file cannot be made.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._shapes: list[tuple[int, ...]] = []
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._stream = tempfile.TemporaryFile(dir=folder, prefix=TEMPORARY_PREFIX)  # noqa: SIM115 closed at the end
        except OSError as error:
            raise write_problem(folder, error) from error

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self._stream.close()

    def add(self, array: NDArray[np.uint8]) -> None:
        """Write an array; raises `DiskError` when the disk is full."""
        try:
            self._stream.write(np.ascontiguousarray(array).data)
        except OSError as error:
            raise write_problem(self._folder, error) from error
        self._shapes.append(array.shape)

    def arrays(self) -> list[NDArray[np.uint8]]:
        """Return the arrays in their order. What is written into them stays in memory."""
        if not self._shapes:
            return []
        try:
            self._stream.flush()
            # One map for all: each has an open file of its own, of which a process may have some hundred.
            data = mmap.mmap(self._stream.fileno(), 0, access=mmap.ACCESS_COPY)
        except OSError as error:
            raise write_problem(self._folder, error) from error
        found, begin = [], 0
        for shape in self._shapes:
            found.append(np.frombuffer(data, np.uint8, math.prod(shape), begin).reshape(shape))
            begin += math.prod(shape)
        return found
