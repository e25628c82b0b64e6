"""Which Gaussians there are after relocation and growth, told by rows of those before."""

from __future__ import annotations

from collections.abc import Mapping

import torch


class Population:
    """N Gaussians without colours and features, which `densify` relocates and adds to as to `Parameters`.

    The rest of each Gaussian is that of its source, so it can stay where it is, on a graphics card.

    Parameters
    ----------
    geometry : mapping of str to tensor of shape [N, ...]
        ``means``, ``log_scales``, ``quats``, ``opacity_logits``; copied.
    n_background : int
        See `Parameters`.

    Attributes
    ----------
    values : dict of str to tensor
        The geometry, and ``sources``, int64 [N]: the row that each Gaussian had, or that it is a copy of.
    fresh : bool tensor of shape [N]
        Gaussians whose moments are zero.
    """

    def __init__(self, geometry: Mapping[str, torch.Tensor], *, n_background: int) -> None:
        n = len(geometry["means"])
        self.values = {name: value.clone() for name, value in geometry.items()} | {"sources": torch.arange(n)}
        self.fresh = torch.zeros(n, dtype=torch.bool)
        self.n_background = n_background

    def __len__(self) -> int:
        return len(self.fresh)

    @property
    def geometry(self) -> dict[str, torch.Tensor]:
        """The values without the sources."""
        return {name: value for name, value in self.values.items() if name != "sources"}

    def overwrite(self, rows: torch.Tensor, new: dict[str, torch.Tensor]) -> None:
        """Set the named values of `rows`, whose moments are then zero."""
        for name, value in new.items():
            self.values[name][rows] = value
        self.fresh[rows] = True

    def append(self, new: dict[str, torch.Tensor]) -> None:
        """Add Gaussians, with values for every name; their moments are zero."""
        self.values = {name: torch.cat([value, new[name]]) for name, value in self.values.items()}
        self.fresh = torch.cat([self.fresh, torch.ones(len(new["sources"]), dtype=torch.bool)])

    def copies(self, rows: torch.Tensor) -> dict[str, torch.Tensor]:
        """Return the values of `rows`."""
        return {name: value[rows] for name, value in self.values.items()}
