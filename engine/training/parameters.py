"""The parameters of the Gaussians during training, one leaf tensor each, with the moments of Adam."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from ..rasterizer import Raster, rasterize
from ..rasterizer.settings import Backend
from ..scene import Gaussians, PinholeCamera
from .adam import AdamState, adam_step
from .settings import FeatureSettings

NAMES = ("means", "log_scales", "quats", "opacity_logits", "sh_dc", "sh_rest", "features")


@dataclass
class Parameters:
    """N Gaussians in training.

    Attributes
    ----------
    values : dict of str to tensor of shape [N, ...], float32
        Leaf tensors by name, see `NAMES`; ``sh_rest`` is missing at degree 0, ``features`` when they are not trained.
    moments : dict of str to AdamState
        Moments for the same names.
    n_background : int
        The first so many rows are the background: only their features are trained, and they are neither copied nor
        relocated.
    """

    values: dict[str, torch.Tensor]
    moments: dict[str, AdamState]
    n_background: int = 0

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
                raise ValueError("features are to be trained and the initial Gaussians have none")
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
        """Return a copy of all values and moments."""
        values = {name: value.detach().clone() for name, value in self.values.items()}
        return Parameters(values, {name: moment.copy() for name, moment in self.moments.items()}, self.n_background)

    def cut_sh(self, degree: int) -> None:
        """Remove all bands above `degree`, with their moments."""
        rest = (degree + 1) ** 2 - 1
        if "sh_rest" not in self.values or rest >= self.values["sh_rest"].shape[1]:
            return
        value, moment = self.values.pop("sh_rest"), self.moments.pop("sh_rest")
        if rest:
            self.values["sh_rest"] = value.detach()[:, :rest].contiguous()
            mean, square = (part[:, :rest].contiguous() for part in (moment.mean, moment.square))
            self.moments["sh_rest"] = AdamState(mean, square, moment.step)

    def track(self) -> None:
        """Require gradients of all values, and clear earlier ones."""
        for value in self.values.values():
            value.requires_grad_(True)
            value.grad = None

    def step(self, learning_rates: dict[str, float]) -> None:
        """Make one Adam step, in place, for each named value that has a gradient; others keep their moments."""
        names = [name for name in learning_rates if name in self.values and self.values[name].grad is not None]
        with torch.no_grad():
            for name in names:
                if self.n_background and name != "features":
                    self.values[name].grad[: self.n_background] = 0.0  # type: ignore[index]
            triples = [(self.values[n].detach(), self.values[n].grad, learning_rates[n]) for n in names]
            adam_step(triples, [self.moments[n] for n in names])  # type: ignore[arg-type]

    def overwrite(self, rows: torch.Tensor, new: dict[str, torch.Tensor]) -> None:
        """Set the named values of `rows` and reset all moments of these rows."""
        with torch.no_grad():
            for name, value in self.values.items():
                if name in new:
                    value.detach()[rows] = new[name]
                self.moments[name].mean[rows] = 0.0
                self.moments[name].square[rows] = 0.0

    def append(self, new: dict[str, torch.Tensor]) -> None:
        """Add Gaussians, with values for every name; their moments are zero."""
        for name, value in self.values.items():
            self.values[name] = torch.cat([value.detach(), new[name]])
            state = self.moments[name]
            zeros = torch.zeros_like(new[name])
            state.mean = torch.cat([state.mean, zeros])
            state.square = torch.cat([state.square, zeros])

    def keep(self, rows: torch.Tensor) -> None:
        """Remove all Gaussians but `rows`, which begin with those of the background."""
        for name, value in self.values.items():
            self.values[name] = value.detach()[rows]
            moment = self.moments[name]
            self.moments[name] = AdamState(moment.mean[rows], moment.square[rows], moment.step)

    def copies(self, rows: torch.Tensor) -> dict[str, torch.Tensor]:
        """Return the values of `rows`."""
        return {name: value.detach()[rows] for name, value in self.values.items()}

    def to_gaussians(self, *, unit_features: bool) -> Gaussians:
        """Return the Gaussians as arrays; `unit_features` normalises their features, as blending does."""
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
    *,
    backend: Backend,
    sh_degree: int | None,
    channels: torch.Tensor | None = None,
    detached_channels: bool = False,
    opacities: torch.Tensor | None = None,
) -> Raster:
    """Render `values` from `camera`.

    Parameters
    ----------
    values : dict of str to tensor
        As in `Parameters.values`.
    backend : {"cpu", "gpu", "reference"}
        Which rasterizer is used.
    sh_degree : int or None
        Highest band to use; None for a picture without colour.
    channels : tensor of shape [N, C], optional
        Further values per Gaussian, blended after the colour: features, errors.
    detached_channels : bool
        Whether their gradient changes no Gaussian.
    opacities : tensor of shape [N], optional
        In place of those of `values`.
    """
    sh = None
    if sh_degree is not None:
        # Unused bands must not get zero gradients, because Adam would count these as steps.
        sh = torch.cat([values["sh_dc"], values["sh_rest"]], dim=1) if sh_degree else values["sh_dc"]
    return rasterize(
        values["means"],
        values["quats"],
        values["log_scales"].exp(),
        values["opacity_logits"].sigmoid() if opacities is None else opacities,
        camera=camera,
        sh=sh,
        sh_degree=sh_degree,
        channels=channels,
        detached_channels=detached_channels,
        backend=backend,
    )


def blended_features(values: dict[str, torch.Tensor], settings: FeatureSettings) -> torch.Tensor:
    """Return the features in the form in which they are blended, shape [N, F]."""
    if settings.feature_init == "unit":
        return torch.nn.functional.normalize(values["features"], dim=1, eps=1e-9)
    return values["features"]
