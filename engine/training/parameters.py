"""The Gaussians while they are trained: one leaf tensor per parameter, with Adam's moments beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from ..rasterizer import AdamState, Raster, adam_step, rasterize
from ..scene import Gaussians, PinholeCamera
from .settings import TrainingSettings

__all__ = ["NAMES", "Parameters", "render"]

NAMES = ("means", "log_scales", "quats", "opacity_logits", "sh_dc", "sh_rest", "features")


@dataclass
class Parameters:
    """N Gaussians in training.

    Attributes
    ----------
    values : dict of str to tensor of shape [N, ...], float32
        Leaf tensors by name, see `NAMES`; ``sh_rest`` is missing at degree 0, ``features`` when none are trained.
    moments : dict of str to AdamState
        For the same names.
    """

    values: dict[str, torch.Tensor]
    moments: dict[str, AdamState]

    @classmethod
    def from_gaussians(cls, start: Gaussians, *, sh_degree: int, features: bool) -> Parameters:
        """Return trainable copies of `start`, its spherical harmonics cut or padded with zeros to `sh_degree`."""
        n_sh = (sh_degree + 1) ** 2
        sh = np.zeros((len(start), n_sh, 3), np.float32)
        shared = min(n_sh, start.sh.shape[1])
        sh[:, :shared] = start.sh[:, :shared]
        arrays: dict[str, NDArray[np.float32]] = {
            "means": start.means,
            "log_scales": start.log_scales,
            "quats": start.quats,
            "opacity_logits": start.opacity_logits,
            "sh_dc": sh[:, :1],
        }
        if n_sh > 1:
            arrays["sh_rest"] = sh[:, 1:]
        if features:
            if start.features is None:
                raise ValueError("features are to be trained and the Gaussians to start from have none")
            arrays["features"] = start.features
        values = {name: torch.tensor(array, dtype=torch.float32) for name, array in arrays.items()}
        return cls(values, {name: AdamState.zeros_like(value) for name, value in values.items()})

    def __len__(self) -> int:
        return len(self.values["means"])

    @property
    def sh_degree(self) -> int:
        """Highest band that is stored."""
        rest = self.values.get("sh_rest")
        return 0 if rest is None else int(round((1 + rest.shape[1]) ** 0.5)) - 1

    def copy(self) -> Parameters:
        """Return Gaussians with values and moments of their own."""
        values = {name: value.detach().clone() for name, value in self.values.items()}
        return Parameters(values, {name: moment.copy() for name, moment in self.moments.items()})

    def cut_sh(self, degree: int) -> None:
        """Drop all bands above `degree`, with their moments."""
        rest = (degree + 1) ** 2 - 1
        if "sh_rest" not in self.values or rest >= self.values["sh_rest"].shape[1]:
            return
        value, moment = self.values.pop("sh_rest"), self.moments.pop("sh_rest")
        if rest:
            self.values["sh_rest"] = value.detach()[:, :rest].contiguous()
            mean, square = (part[:, :rest].contiguous() for part in (moment.mean, moment.square))
            self.moments["sh_rest"] = AdamState(mean, square, moment.step)

    def track(self) -> None:
        """Ask for gradients of all values, starting from none."""
        for value in self.values.values():
            value.requires_grad_(True)
            value.grad = None

    def step(self, learning_rates: dict[str, float]) -> None:
        """Take one Adam step for every named value that has a gradient, in place; the others and their moments stay."""
        names = [name for name in learning_rates if name in self.values and self.values[name].grad is not None]
        with torch.no_grad():
            triples = [(self.values[n].detach(), self.values[n].grad, learning_rates[n]) for n in names]
            adam_step(triples, [self.moments[n] for n in names])  # type: ignore[arg-type]

    def overwrite(self, rows: torch.Tensor, new: dict[str, torch.Tensor]) -> None:
        """Set the named values of `rows` and forget all moments of those rows."""
        with torch.no_grad():
            for name, value in self.values.items():
                if name in new:
                    value.detach()[rows] = new[name]
                self.moments[name].mean[rows] = 0.0
                self.moments[name].square[rows] = 0.0

    def append(self, new: dict[str, torch.Tensor]) -> None:
        """Add Gaussians, with a row for every name; their moments are zero."""
        for name, value in self.values.items():
            self.values[name] = torch.cat([value.detach(), new[name]])
            state = self.moments[name]
            nothing = torch.zeros_like(new[name])
            state.mean = torch.cat([state.mean, nothing])
            state.square = torch.cat([state.square, nothing])

    def copies(self, rows: torch.Tensor) -> dict[str, torch.Tensor]:
        """Return the values of `rows`."""
        return {name: value.detach()[rows] for name, value in self.values.items()}

    def to_gaussians(self, *, unit_features: bool) -> Gaussians:
        """Return the Gaussians as arrays; with `unit_features`, their features as they are blended: normalised."""
        values = {name: value.detach().numpy().copy() for name, value in self.values.items()}
        sh = values["sh_dc"]
        if "sh_rest" in values:
            sh = np.concatenate([sh, values["sh_rest"]], axis=1)
        features = values.get("features")
        if features is not None and unit_features:
            features = features / np.maximum(np.linalg.norm(features, axis=1, keepdims=True), 1e-9)
        return Gaussians(
            means=values["means"],
            log_scales=values["log_scales"],
            quats=values["quats"],
            opacity_logits=values["opacity_logits"],
            sh=sh,
            features=features,
        )


def render(
    values: dict[str, torch.Tensor],
    camera: PinholeCamera,
    settings: TrainingSettings,
    *,
    sh_degree: int | None,
    features: bool = False,
    extra: torch.Tensor | None = None,
) -> Raster:
    """Return the picture of `values` from `camera`.

    Parameters
    ----------
    values : dict of str to tensor
        As in `Parameters.values`.
    camera : PinholeCamera
    settings : TrainingSettings
        Which rasterizer, and whether features are normalised first.
    sh_degree : int or None
        Highest band to use; None for a picture without colour.
    features : bool
        Whether the features follow the colour as channels.
    extra : tensor of shape [N, C], optional
        Other channels, instead of the features.
    """
    sh = None
    if sh_degree is not None:
        # Bands that are not used yet must not get (zero) gradients: Adam would count them.
        sh = torch.cat([values["sh_dc"], values["sh_rest"]], dim=1) if sh_degree else values["sh_dc"]
    return rasterize(
        values["means"],
        values["quats"],
        values["log_scales"].exp(),
        values["opacity_logits"].sigmoid(),
        camera=camera,
        sh=sh,
        sh_degree=sh_degree,
        channels=blended_features(values, settings) if features else extra,
        backend=settings.backend,
    )


def blended_features(values: dict[str, torch.Tensor], settings: TrainingSettings) -> torch.Tensor:
    """Return the features as they are blended, shape [N, F]."""
    if settings.feature_init == "unit":
        return torch.nn.functional.normalize(values["features"], dim=1, eps=1e-9)
    return values["features"]
