"""Cost of gsplat's whole training steps, beside `benchmarks.gpu_step` on the same card; a part of ``make bench-gpu``.

A step: activations, image, L1 + SSIM, gradients, torch's fused Adam; with features also L_CC and L_reg in torch. The
disagreement along rays, the random walk and the limits of our steps are left out. Features are rendered in the quicker
of two ways, with the colours or after them. The SSIM is torch's, or with ``--fused-ssim`` that of fused-ssim (MIT),
compiled from its ``ssim.cu`` and ``ssim.h``. Without gsplat 1.5 or CUDA nothing is measured.

example: python -m benchmarks.gpu_gsplat_step 1000000 --fused-ssim ../fused-ssim
"""

from __future__ import annotations

import argparse
import importlib.util
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.nn import functional

from benchmarks.gpu import HEIGHT, WIDTH, camera, has_cuda, scene
from benchmarks.gpu_step import CASES, ROUNDS, SETTINGS, STEPS, segments
from engine.core.files import write_json
from engine.formats import SH_C0
from engine.training.losses.neighbours import N_ANCHORS, N_FAR, N_FAR_CANDIDATES, N_NEIGHBOURS

DEVICE = "cuda"
TILE = 16
FAR = 1.0
"""Distance beyond which features are pushed apart, as in `benchmarks.gpu_step`."""
RATES = {"means": 1.6e-4, "quats": 1e-3, "scales": 5e-3, "opacities": 5e-2, "sh_dc": 2.5e-3, "sh_rest": 1.25e-4}
"""gsplat's rates; they are multiplied by 1e-5, so that the work stays the same while it is timed."""

_WINDOW, _SIGMA = 11, 1.5
_C1, _C2 = 0.01**2, 0.03**2
"""Window and constants of SSIM (Wang et al. 2004)."""

Ssim = Callable[[torch.Tensor, torch.Tensor], torch.Tensor]


def fused_ssim(folder: Path) -> Ssim:
    """Compile fused-ssim and return its mean SSIM of two pictures of shape [1, 3, H, W]."""
    from torch.utils.cpp_extension import load

    binding = folder / "binding.cpp"
    if not binding.exists():
        binding.write_text(
            '#include <torch/extension.h>\n#include "ssim.h"\nPYBIND11_MODULE(TORCH_EXTENSION_NAME, m) {\n'
            '  m.def("fusedssim", &fusedssim);\n  m.def("fusedssim_backward", &fusedssim_backward);\n}\n'
        )
    flags = ["-O3", "--use_fast_math", "--maxrregcount=32"]
    module = load("fused_ssim_only", [str(folder / "ssim.cu"), str(binding)], extra_cuda_cflags=flags)

    class Map(torch.autograd.Function):
        @staticmethod
        def forward(context: Any, image: torch.Tensor, photo: torch.Tensor) -> torch.Tensor:
            values, *derivatives = module.fusedssim(_C1, _C2, image, photo, True)
            context.save_for_backward(image.detach(), photo, *derivatives)
            return values  # type: ignore[no-any-return]

        @staticmethod
        def backward(context: Any, *gradients: torch.Tensor) -> Any:
            image, photo, *derivatives = context.saved_tensors
            return module.fusedssim_backward(_C1, _C2, image, photo, gradients[0].contiguous(), *derivatives), None

    return lambda image, photo: Map.apply(image.contiguous(), photo).mean()  # type: ignore[no-untyped-call]


def ssim(x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
    """Return the mean SSIM of two pictures [1, 3, H, W] on the same device."""
    offsets = torch.arange(_WINDOW, device=x.device) - _WINDOW // 2
    weights = torch.exp(-(offsets**2) / (2 * _SIGMA**2))
    window = torch.outer(weights, weights) / weights.sum() ** 2
    maps = torch.cat([x, y, x * x, y * y, x * y], dim=1)
    blurred = functional.conv2d(maps, window.repeat(15, 1, 1, 1), padding=_WINDOW // 2, groups=15)
    mean_x, mean_y, xx, yy, xy = blurred.split(3, dim=1)
    covariance, variances = xy - mean_x * mean_y, xx + yy - mean_x**2 - mean_y**2
    similar = (2 * mean_x * mean_y + _C1) * (2 * covariance + _C2)
    return (similar / ((mean_x**2 + mean_y**2 + _C1) * (variances + _C2))).mean()


class GsplatStep:
    """Training steps of a case.

    Parameters
    ----------
    n : int
        Number of Gaussians.
    case : str
        Of `benchmarks.gpu_step`. Losses of features are evaluated in each step.
    structural : callable
    splits : bool
        Whether features are rendered after the colours, by the same lists, instead of with them.
    """

    def __init__(self, n: int, case: str, structural: Ssim, *, splits: bool) -> None:
        self.degree, self.has_features, _ = CASES[case]
        self.n, self.ssim, self.splits = n, structural, splits
        arrays = scene(n)
        values = {name: arrays[name] for name in ("means", "quats")}
        values["scales"] = np.log(arrays["scales"])
        values["opacities"] = np.log(arrays["opacities"] / (1.0 - arrays["opacities"]))
        values["sh_dc"] = arrays["sh"][:, :1]
        if self.degree:
            values["sh_rest"] = arrays["sh"][:, 1:]
        if self.has_features:
            values["features"] = arrays["channels"][:, 3:]
        self.values = {
            name: torch.nn.Parameter(torch.tensor(np.ascontiguousarray(value), dtype=torch.float32, device=DEVICE))
            for name, value in values.items()
        }
        groups = [{"params": [value], "lr": 1e-5 * RATES.get(name, 2.5e-3)} for name, value in self.values.items()]
        self.optimiser = torch.optim.Adam(groups, eps=1e-15, fused=True)
        self.viewmats = torch.eye(4, device=DEVICE)[None]
        self.intrinsics = torch.tensor(camera().K, dtype=torch.float32, device=DEVICE)[None]
        photo = np.random.default_rng(2).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
        self.photo = torch.from_numpy(photo).to(DEVICE).float()[None] / 255.0
        self.photo_planes = self.photo.permute(0, 3, 1, 2).contiguous()
        labelled = segments()
        self.pixels, self.clusters = (
            torch.from_numpy(a).to(DEVICE).long() for a in labelled.at(np.arange(len(labelled)))
        )
        self.counts = labelled.counts.to(DEVICE)
        # Which Gaussians are near does not change the time, nor does the search for them, which is timed apart.
        self.neighbours = torch.randint(n, (n, N_NEIGHBOURS), device=DEVICE)

    def __call__(self) -> None:
        """Make one step."""
        values = self.values
        scales, opacities = values["scales"].exp(), values["opacities"].sigmoid()
        image, features = self._rendered(scales, opacities)
        loss = 0.8 * functional.l1_loss(image, self.photo)
        loss = loss + 0.2 * (1.0 - self.ssim(image.permute(0, 3, 1, 2), self.photo_planes))
        loss = loss + 0.01 * opacities.mean() + 0.002 * scales.mean()
        if features is not None:
            loss = loss + self._clustering(features.reshape(WIDTH * HEIGHT, -1)) + self._regulariser()
        loss.backward()  # type: ignore[no-untyped-call]
        self.optimiser.step()
        self.optimiser.zero_grad(set_to_none=True)

    def _rendered(self, scales: torch.Tensor, opacities: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor | None]:
        import gsplat

        values = self.values
        if self.degree and not self.has_features:
            sh = torch.cat([values["sh_dc"], values["sh_rest"]], dim=1)
            image, _, _ = gsplat.rasterization(
                values["means"], values["quats"], scales, opacities, sh, self.viewmats, self.intrinsics, WIDTH, HEIGHT,
                sh_degree=3, packed=False, tile_size=TILE,
            )  # fmt: skip
            return image, None
        radii, centres, depths, conics, _ = gsplat.fully_fused_projection(
            values["means"], None, values["quats"], scales, self.viewmats, self.intrinsics, WIDTH, HEIGHT, packed=False,
            opacities=opacities,
        )  # fmt: skip
        columns, rows = -(-WIDTH // TILE), -(-HEIGHT // TILE)
        _, ids, flat = gsplat.isect_tiles(centres, radii, depths, TILE, columns, rows, packed=False, n_images=1)
        offsets = gsplat.isect_offset_encode(ids, 1, columns, rows).reshape(1, rows, columns)

        def blended(channels: torch.Tensor) -> torch.Tensor:
            image, _ = gsplat.rasterize_to_pixels(
                centres, conics, channels.contiguous()[None], opacities[None], WIDTH, HEIGHT, TILE, offsets, flat
            )
            return image  # type: ignore[no-any-return]

        if self.degree:  # the camera is at the origin
            sh = torch.cat([values["sh_dc"], values["sh_rest"]], dim=1)
            colors = gsplat.spherical_harmonics(3, values["means"], sh, masks=(radii[0] > 0).all(-1))
        else:
            colors = SH_C0 * values["sh_dc"][:, 0]
        colors = (colors + 0.5).clamp_min(0.0)
        if not self.has_features:
            return blended(colors), None
        if self.splits:
            return blended(colors), blended(values["features"])
        both = blended(torch.cat([colors, values["features"]], dim=1))
        return both[..., :3], both[..., 3:]

    def _clustering(self, features: torch.Tensor) -> torch.Tensor:
        """Return `engine.training.losses.clustering_loss`, on the card and without a wait."""
        n_samples, n_clusters = SETTINGS.features.clustering_pixels, len(self.counts)
        drawn = torch.randint(len(self.pixels), (n_samples,), device=DEVICE)
        cluster = self.clusters[drawn]
        f = functional.normalize(features[self.pixels[drawn]], dim=1)
        sampled = torch.zeros(n_clusters, device=DEVICE).index_add(0, cluster, torch.ones(n_samples, device=DEVICE))
        means = torch.zeros(n_clusters, f.shape[1], device=DEVICE).index_add(0, cluster, f)
        means = means / sampled.clamp_min(1)[:, None]
        with torch.no_grad():
            distance = (f - means[cluster]).norm(dim=1)
            spread = torch.zeros_like(sampled).index_add(0, cluster, distance) / sampled.clamp_min(1)
            phi = (10.0 * spread / torch.log(self.counts + 100.0)).clamp(0.1, 1.0)
        loss = functional.cross_entropy(
            (f @ means.T / phi).masked_fill(sampled == 0, -torch.inf), cluster, reduction="sum"
        )
        return 1e-6 * loss * (len(self.pixels) / n_samples / n_clusters)

    def _regulariser(self) -> torch.Tensor:
        """Return `engine.training.losses.neighbour_regulariser`, on the card and without a wait."""
        anchors = torch.randint(self.n, (N_ANCHORS,), device=DEVICE)
        tries = torch.randint(self.n, (N_ANCHORS, N_FAR_CANDIDATES), device=DEVICE)
        features, places = self.values["features"], self.values["means"].detach()
        at = functional.normalize(features[anchors], dim=1)[:, None]
        near = (at * functional.normalize(features[self.neighbours[anchors]], dim=2)).sum(dim=2).mean()
        is_far = (places[anchors, None] - places[tries]).norm(dim=2) > FAR
        is_far &= is_far.cumsum(dim=1) <= N_FAR
        distant = (
            (at * functional.normalize(features[tries], dim=2)).sum(dim=2) * is_far
        ).sum() / is_far.sum().clamp_min(1)
        return 0.05 * torch.sigmoid(1.0 - near) + 0.15 * torch.sigmoid(distant)


def milliseconds(step: GsplatStep) -> float:
    """Return the wall time of one of many steps queued one after the other, the median of rounds."""

    def steps() -> float:
        start = time.perf_counter()
        for _ in range(STEPS):
            step()
        torch.cuda.synchronize()
        return 1e3 * (time.perf_counter() - start) / STEPS

    steps()
    return statistics.median(steps() for _ in range(ROUNDS))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("n", type=int, nargs="?", default=1_000_000, help="number of Gaussians")
    parser.add_argument("--results", type=Path, default=Path("out/gpu"))
    parser.add_argument("--fused-ssim", type=Path, help="folder with ssim.cu and ssim.h of fused-ssim")
    options = parser.parse_args()
    if importlib.util.find_spec("gsplat") is None or not has_cuda():
        print("gsplat or CUDA is missing; nothing was measured.", file=sys.stderr)
        return
    structural: Ssim = ssim if options.fused_ssim is None else fused_ssim(options.fused_ssim)
    options.results.mkdir(parents=True, exist_ok=True)
    figures: dict[str, dict[str, Any]] = {}
    for case, (_, has_features, interval) in CASES.items():
        if interval > 1:
            continue
        ways = {"after the colours": True, "with the colours": False} if has_features else {"": False}
        found = {}
        for way, splits in ways.items():
            torch.cuda.empty_cache()
            torch.cuda.reset_peak_memory_stats()
            step = GsplatStep(options.n, case, structural, splits=splits)
            found[way] = {"step": milliseconds(step), "MB": torch.cuda.max_memory_allocated() / 1e6}
            del step
            print(case, way, {name: round(value, 2) for name, value in found[way].items()}, flush=True)
        best = min(found, key=lambda way: found[way]["step"])
        figures[case] = {**found[best], "features": best}
    of = "torch's" if options.fused_ssim is None else "fused-ssim's"
    card = torch.cuda.get_device_name()
    write_json(options.results / f"gsplat_step_{options.n}.json", {"card": card, "ssim": of, "cases": figures})


if __name__ == "__main__":
    main()
