"""Label maps in memory as runs of equal labels, without loss: segments are areas, so a row has few of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arrays import Int32


@dataclass(frozen=True, eq=False)
class LabelRuns:
    """A label map of R runs of equal labels, read row by row.

    Attributes
    ----------
    shape : (int, int)
        Height and width.
    ends : array of shape [R], int32
        Pixels up to the end of each run.
    labels : array of shape [R], int32
        Label of each run.
    """

    shape: tuple[int, int]
    ends: Int32
    labels: Int32

    @classmethod
    def of(cls, labels: Int32) -> LabelRuns:
        """Return the runs of a label map, int32 [h, w]."""
        flat = labels.ravel()
        ends = np.append(np.flatnonzero(flat[1:] != flat[:-1]) + 1, flat.size) if flat.size else np.zeros(0, np.intp)
        height, width = labels.shape
        return cls((height, width), ends.astype(np.int32), flat[ends - 1].astype(np.int32))

    @property
    def nbytes(self) -> int:
        """Bytes in memory."""
        return self.ends.nbytes + self.labels.nbytes

    def array(self) -> Int32:
        """Return the label map, int32 [h, w]."""
        return np.repeat(self.labels, np.diff(self.ends, prepend=0)).reshape(self.shape)
