"""One budget of memory for all threads that decode photos."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator

from ..core.errors import PhotoError
from ..core.system import free_memory

_SHARE_OF_FREE = 0.75
"""Share of the free memory that may be used for decoding."""
_BYTES_WHERE_UNKNOWN = 4 << 30
"""The budget where the system does not state its free memory."""


class MemoryBudget:
    """Bytes that several threads share: each waits until what it needs is left.

    Parameters
    ----------
    always : int
        A single use of at most this many bytes is never refused.
    """

    def __init__(self, always: int) -> None:
        self._always = always
        self._changed = threading.Condition()
        self._used = self._capacity = 0

    @contextlib.contextmanager
    def reserved(self, n_bytes: int, what: str) -> Iterator[None]:
        """Reserve `n_bytes` for a block of code.

        Parameters
        ----------
        what : str
            Subject of the message, e.g. "a.png has 19900 x 19900 pixels".

        Raises
        ------
        PhotoError
            When more bytes are needed than the whole budget has.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._used == 0 or self._used + n_bytes <= self._capacity)
            if self._used == 0:
                # Only when idle: the free memory lacks what the other threads have reserved and partly allocated.
                free = free_memory()
                self._capacity = _BYTES_WHERE_UNKNOWN if free is None else int(_SHARE_OF_FREE * free)
                if n_bytes > max(self._capacity, self._always):
                    raise PhotoError(
                        f"{what}, which takes {n_bytes / 1e9:.1f} GB of memory to read; at most "
                        f"{self._capacity / 1e9:.1f} GB can be used now. Reduce its size, or close other programs."
                    )
            self._used += n_bytes
        try:
            yield
        finally:
            with self._changed:
                self._used -= n_bytes
                self._changed.notify_all()


DECODING = MemoryBudget(always=512 << 20)
"""The budget of this process."""
