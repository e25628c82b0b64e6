"""What a file says beside its Gaussians or its mesh: one form of it for the writers of all formats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .axes import Up, file_from_z_up


@dataclass(frozen=True)
class FileFacts:
    """What a file says beside its Gaussians. A format leaves out what it has no place for.

    Attributes
    ----------
    name : str
        Title of what the file shows.
    matrix : array of shape [4, 4], float64, optional
        A transform of the Gaussians, from the engine's world (Z up) to that of the file, Z up.
    up : {"z", "-y", "y"}, optional
        Axis that points up in files of formats that define none; None: the Gaussians are not turned.
    metres_per_unit : float, optional
        None: unknown.
    extras : mapping, optional
        The record, as JSON values.
    comments : sequence of str
        The record, as lines.
    rights : str, optional
        Credit line or rights statement.
    xmp : mapping, optional
        The record, as a packet of XMP.
    seen : array of shape [N], int, optional
        Number of photos that saw each Gaussian.
    properties : mapping of str to array of shape [N]
        Further properties of a PLY.
    header : sequence of str
        Header of the PLY from which the Gaussians came, see `write_ply`; a PLY alone takes it.
    header_up : {"z", "-y", "y"}, optional
        Axis that points up in that PLY.
    lost : array of shape [N, 3], optional
        See `write_ply`.
    """

    name: str = "Gaussians"
    matrix: NDArray[np.float64] | None = None
    up: Up | None = "-y"
    metres_per_unit: float | None = None
    extras: Mapping[str, Any] | None = None
    comments: Sequence[str] = ()
    rights: str | None = None
    xmp: Mapping[str, Any] | None = None
    seen: NDArray[np.integer] | None = None
    properties: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    header: Sequence[str] = ()
    header_up: Up | None = None
    lost: NDArray[np.floating] | None = None

    def transform(self, up: Up | None) -> NDArray[np.float64]:
        """Return the transform [4, 4] from the engine's world (Z up) to that of a file whose axis `up` points up."""
        turn = file_from_z_up(up)
        return turn if self.matrix is None else turn @ self.matrix


NO_FACTS = FileFacts()
