"""Rows of a 3DGS PLY: Gaussians are put into them, and values of named properties are taken out of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ..scene import Gaussians

Columns = Callable[..., NDArray[np.float32]]
Put = Callable[[Gaussians, int], None]

POSITION = ("x", "y", "z")
NORMAL = ("nx", "ny", "nz")
COLOR = ("f_dc_0", "f_dc_1", "f_dc_2")
SCALE = ("scale_0", "scale_1", "scale_2")
ROTATION = ("rot_0", "rot_1", "rot_2", "rot_3")
_FLOAT = np.dtype("<f4")


def rest_names(count: int) -> tuple[str, ...]:
    """Return the names of `count` coefficients of the bands above 0, channel by channel."""
    return tuple(f"f_rest_{i}" for i in range(count))


class RowsToWrite:
    """Memory for some rows, into which Gaussians are put again and again.

    The values of a property group, such as the three coordinates, are copied as one item of several bytes where their
    columns are neighbours: that takes half the time of copying numbers.

    Parameters
    ----------
    dtype : dtype
        Type of a row.
    count : int
        Most Gaussians at once.
    n_sh : int
        Coefficients of each channel.
    extra : sequence of str
        Names of further properties.
    """

    def __init__(self, dtype: np.dtype[np.void], count: int, n_sh: int, extra: Sequence[str]) -> None:
        # Views of an empty buffer cannot be made.
        self._rows = np.zeros(max(count, 1), dtype)
        self._table = _table(self._rows)
        self._extra = tuple(extra)
        rest = rest_names(3 * (n_sh - 1))
        # A header of 2D Gaussians has two scales.
        scales = tuple(name for name in SCALE if name in (dtype.names or ()))
        self._puts: list[Put] = [
            self._put(POSITION, lambda part: part.means),
            self._put(COLOR, lambda part: part.sh[:, 0]),
            self._put(scales, lambda part: part.log_scales[:, : len(scales)]),
            self._put(ROTATION, lambda part: part.quats),
            self._put(("opacity",), lambda part: part.opacity_logits[:, None]),
        ]
        if rest:
            self._puts.append(self._put_rest(rest, n_sh - 1))

    def put(
        self, part: Gaussians, extra: Mapping[str, NDArray[Any]], places: NDArray[np.float64] | None = None
    ) -> NDArray[np.uint8]:
        """Return the bytes of the rows of `part` and of its further properties; other properties are 0.

        `places` [n, 3] are written instead of the means.
        """
        count = len(part)
        for put in self._puts:
            put(part, count)
        for name in self._extra:
            self._rows[name][:count] = extra[name]
        for column, name in enumerate(POSITION if places is not None else ()):
            values = cast(Any, places)[:, column]
            self._rows[name][:count] = np.rint(values) if self._rows.dtype[name].kind in "iu" else values
        return self._rows[:count].view(np.uint8)

    def are_finite(self, count: int) -> bool:
        """Return whether the first `count` rows have finite values only; False, too, where that is not sure."""
        if self._table is None:
            return False
        # A sum is not finite where a value is not, and takes a third of the time; it may overflow where all are.
        return bool(np.isfinite(self._table[:count].sum()))

    def _put(self, names: tuple[str, ...], values: Callable[[Gaussians], NDArray[Any]]) -> Put:
        place = self._place(names)
        if place is None:
            return self._put_columns(names, values)
        items = np.ndarray(len(self._rows), f"V{4 * len(names)}", self._rows, place, self._rows.strides)

        def put(part: Gaussians, count: int) -> None:
            taken = values(part)
            if taken.dtype != _FLOAT or taken.strides[-1] != 4:
                taken = np.ascontiguousarray(taken, _FLOAT)
            items[:count] = taken.view(items.dtype)[:, 0]

        return put

    def _put_rest(self, names: tuple[str, ...], bands: int) -> Put:
        place = self._place(names)
        if place is None:
            return self._put_columns(names, lambda part: part.sh[:, 1:].transpose(0, 2, 1).reshape(len(part), -1))
        strides = (*self._rows.strides, 4 * bands, 4)
        target = np.ndarray((len(self._rows), 3, bands), _FLOAT, self._rows, place, strides)

        def put(part: Gaussians, count: int) -> None:
            target[:count] = part.sh[:, 1:].transpose(0, 2, 1)

        return put

    def _put_columns(self, names: tuple[str, ...], values: Callable[[Gaussians], NDArray[Any]]) -> Put:
        def put(part: Gaussians, count: int) -> None:
            taken = values(part)
            for column, name in enumerate(names):
                self._rows[name][:count] = taken[:, column]

        return put

    def _place(self, names: tuple[str, ...]) -> int | None:
        """Return where in a row the columns `names` begin; None unless they are neighbours and of the type ``<f4``."""
        fields: Mapping[str, Any] = self._rows.dtype.fields or {}
        first = fields[names[0]][1]
        expected = {name: (_FLOAT, first + 4 * index) for index, name in enumerate(names)}
        return first if all(fields[name][:2] == place for name, place in expected.items()) else None


def columns_of(rows: NDArray[np.void]) -> Columns:
    """Return a function that gives the values of named properties of some rows, [n, properties], float32."""
    names = list(rows.dtype.names or ())
    table = _table(rows)

    def columns(*wanted: str) -> NDArray[np.float32]:
        if table is not None:
            return table[:, _index([names.index(name) for name in wanted])]
        # What float32 cannot hold becomes infinite, and is refused or skipped as such.
        with np.errstate(over="ignore"):
            return np.stack([rows[name].astype(np.float32) for name in wanted], axis=1)

    return columns


def _table(rows: NDArray[Any]) -> NDArray[np.float32] | None:
    """Return `rows` as a table [N, n_properties] of the same memory; None unless all are little-endian float32."""
    names = rows.dtype.names or ()
    if any(rows.dtype[name] != _FLOAT for name in names):
        return None
    return rows.view(_FLOAT).reshape(len(rows), len(names))


def _index(columns: list[int]) -> slice | list[int]:
    """Return what selects `columns`: a slice, which needs no copy, where they are neighbours."""
    first = columns[0]
    return slice(first, first + len(columns)) if columns == list(range(first, first + len(columns))) else columns
