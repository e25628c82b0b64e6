"""Errors and veils in views that no photo has, the share of needles, and the table of all."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from engine.core.files import ArraySpec, atomic_write, read_arrays
from engine.rasterizer import rotation_matrices
from engine.rasterizer.settings import MAX_CHANNELS, Backend
from engine.scene import CameraSet, Gaussians, PinholeCamera
from engine.training import Parameters, TrainingView, render
from engine.training.held_out import image_quality, render_picture
from engine.training.settings import FeatureSettings
from engine.training.trials import brightness_factors
from engine.training.views import ViewPyramid

from .views_file import read_views, write_views

OFF_PATH, OFF_PATH_ON_PROCESSOR = "off the path", "off the path on the processor"
"""Names of the tables in a document, of trainings on a card and on the processor."""
KINDS = ("near", "far", "above")
"""What the names of views begin with: half the distance of a photo, one and a half times, and 20 degrees higher."""

N_PLACES = 3
"""Photos of a room whose places views are made from; each gives a view of each kind, unless its way is blocked."""

_NEEDLE = 5.0
"""A Gaussian is a needle if it is longer than so many times its middle axis."""
_VISIBLE = 0.05
"""Gaussians of a lower opacity are not counted."""
_BEFORE = 0.95
"""What lies wholly nearer than this part of the true depth is a veil."""
_HALF_DEPTH = 2.0
"""Standard deviations along the view axis that a Gaussian reaches: a floor seen at an angle lies partly nearer than its
centre."""
_N_SLABS = MAX_CHANNELS
"""Number of depths that a place is compared with: a veil is counted where it begins at most one of them too near."""

_DEPTHS = {"depths": ArraySpec("float32", ("v", -1, -1), finite=True)}
_ADVICE = "Make it again with `python -m benchmarks.training.card prepare-rooms`."


@dataclass(frozen=True)
class TrueView:
    """A view that no photo has.

    Attributes
    ----------
    view : TrainingView
        With its true picture; valid pixels show what enough photos determine.
    depths : float32 array of shape [H, W]
        True depths along the view axis, world units; 0 where nothing is.
    """

    view: TrainingView
    depths: NDArray[np.float32]


@dataclass(frozen=True)
class OffPath:
    """What is measured in views of each of `KINDS`.

    Attributes
    ----------
    near, far, above : float
        Mean PSNR in dB, with the brightness of each picture fitted; nan without views of the kind.
    veil : float
        Mean opacity of what lies before the true surface, percent.
    views : int
        How many of the ``N_PLACES * len(KINDS)`` views there are; the way to the others is blocked.
    """

    near: float
    far: float
    above: float
    veil: float
    views: int

    @property
    def mean(self) -> float:
        """Mean of the kinds."""
        return (self.near + self.far + self.above) / 3


def write_true_views(file: Path, cameras: CameraSet, views: Sequence[TrueView]) -> None:
    """Write views that no photo has, with the sparse points of the set, and before it their depths beside `file`."""
    with atomic_write(_depths_file(file)) as out:
        np.savez_compressed(out, depths=np.stack([one.depths for one in views]))
    write_views(file, cameras, [one.view for one in views])


def read_true_views(file: Path) -> list[TrueView]:
    """Return what `write_true_views` wrote.

    Raises
    ------
    FormatError
        When a file cannot be read.
    """
    depths = read_arrays(_depths_file(file), _DEPTHS, advice=_ADVICE)["depths"]
    return [TrueView(view, one) for view, one in zip(read_views(file)[1], depths, strict=True)]


def _depths_file(file: Path) -> Path:
    return file.with_name(f"{file.stem}-depths.npz")


def off_path_figures(gaussians: Gaussians, views: Sequence[TrueView], *, backend: Backend = "cpu") -> OffPath:
    """Return the figures of Gaussians in the valid pixels of some views, which are those that enough photos determine.

    Parameters
    ----------
    gaussians : Gaussians
    views : sequence of TrueView
        From `off_path_views.true_views`.
    backend : {"cpu", "gpu"}
    """
    values = Parameters.from_gaussians(gaussians, sh_degree=gaussians.sh_degree, features=False).values
    pyramid = ViewPyramid([one.view for one in views], FeatureSettings())
    found: dict[str, list[float]] = {kind: [] for kind in KINDS}
    veils = []
    for number, one in enumerate(views):
        level = pyramid.level(number, 0)
        if level.valid is not None and not level.valid.any():
            continue
        picture = render_picture(values, level, backend=backend, sh_degree=gaussians.sh_degree)
        fitted = picture * brightness_factors(picture, level)
        found[one.view.photo.split("_")[0]].append(image_quality(fitted, level.pixels, level.valid).psnr)
        counted = one.depths > 0 if level.valid is None else level.valid & (one.depths > 0)
        if counted.any():
            veils.append(float(veil(values, level.camera, one.depths, backend=backend)[counted].mean()))
    kinds = (float(np.mean(found[kind])) if found[kind] else float("nan") for kind in KINDS)
    return OffPath(*kinds, 100 * float(np.mean(veils)), sum(map(len, found.values())))


def veil(
    values: Mapping[str, torch.Tensor], camera: PinholeCamera, depths: NDArray[np.float32], *, backend: Backend = "cpu"
) -> NDArray[np.float32]:
    """Return the opacity of the Gaussians that lie before the true surface of each pixel, [H, W].

    Parameters
    ----------
    values : mapping of str to tensor
        As in `Parameters.values`.
    camera : PinholeCamera
    depths : float32 array of shape [H, W]
        True depths; 0 where nothing is, and the result means nothing.
    """
    ends = _BEFORE * depths
    known = ends[ends > 0]
    edges = np.geomspace(known.min(), known.max(), _N_SLABS).astype(np.float32)
    viewmat = torch.from_numpy(camera.viewmat).float()
    with torch.no_grad():
        axes = torch.einsum("i,nij->nj", viewmat[2, :3], rotation_matrices(values["quats"]))
        reach = _HALF_DEPTH * (axes * values["log_scales"].exp()).norm(dim=1)
        farthest = values["means"] @ viewmat[2, :3] + viewmat[2, 3] + reach
        slab = torch.searchsorted(torch.from_numpy(edges), farthest, right=True)
        channels = torch.nn.functional.one_hot(slab, _N_SLABS + 1)[:, :_N_SLABS].float()
        weights = render(dict(values), camera, backend=backend, sh_degree=None, channels=channels).image
    before = np.cumsum(weights.numpy(), axis=2)
    last = np.clip(np.searchsorted(edges, ends, side="right") - 1, 0, _N_SLABS - 1)
    return np.asarray(np.take_along_axis(before, last[..., None], axis=2)[..., 0])


def needles(gaussians: Gaussians) -> float:
    """Return the share of visible Gaussians longer than five times their middle axis, in percent."""
    ordered = np.sort(gaussians.log_scales[gaussians.opacity_logits > np.log(_VISIBLE / (1 - _VISIBLE))], axis=1)
    return 100 * float((ordered[:, 2] - ordered[:, 1] > np.log(_NEEDLE)).mean())


def off_path_table(results: Sequence[dict[str, Any]]) -> str:
    """Return the table of trainings measured off the path: means over the rooms and seeds of each run.

    Parameters
    ----------
    results : sequence of dict
        ``set``, ``run``, ``seed`` and ``figures`` of each training; those not measured off the path are left out.
    """
    found: dict[str, list[dict[str, Any]]] = {}
    for result in results:
        if "off_path" in result["figures"]:
            found.setdefault(result["run"], []).append(result)
    lines = [
        f"| run | rooms | views | seeds | test photos | {' | '.join(KINDS)} | mean off the path | veil % | needles % |",
        "| --- |" + " ---: |" * (7 + len(KINDS)),
    ]
    for run, rows in found.items():
        figures = [row["figures"] for row in rows]
        kinds = [statistics.mean(one["off_path"][kind] for one in figures) for kind in KINDS]
        psnr, share = (statistics.mean(one[name] for one in figures) for name in ("psnr", "needles"))
        veiled = statistics.mean(one["off_path"]["veil"] for one in figures)
        views = {row["set"]: row["figures"]["off_path"]["views"] for row in rows}
        of_views = f"{sum(views.values())} of {N_PLACES * len(KINDS) * len(views)}"
        cells = [f"{value:.2f}" for value in (psnr, *kinds, statistics.mean(kinds))]
        n_seeds = len({row["seed"] for row in rows})
        lines.append(
            f"| {run} | {len(views)} | {of_views} | {n_seeds} | {' | '.join(cells)} | {veiled:.1f} | {share:.0f} |"
        )
    return "\n".join(lines)
