"""Nearest Gaussians of each, on a card.

Points are sorted by Morton codes; boxes around runs of them are a tree, see search.wgsl. The codes decide how quick the
search is, and never what it finds.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...rasterizer.gpu import Dispatch, Gpu, encode
from .parameters import GpuParameters
from .workspace import TrainingWorkspace

_BRANCHES, _LEVELS = 8, 12  # as in search.wgsl; 12 levels are enough for all numbers of 32 bits

_SAMPLE = 4096
"""Means that the middle and the scale of the scene are found from."""

_QUERIES = 1 << 16
"""Gaussians whose neighbours one submission searches, so that slow cards are not kept busy for too long."""


class NearestSearch(TrainingWorkspace):
    """One search.

    Parameters
    ----------
    pool : dict of str to wgpu.GPUBuffer
    k : int
        Fewer than Gaussians.
    """

    def __init__(self, gpu: Gpu, parameters: GpuParameters, pool: dict[str, Any], k: int) -> None:
        what = f"the search for neighbours of {parameters.n} Gaussians"
        super().__init__(gpu, what, n_channels=k, shared=parameters.buffers, pool=pool)
        self._n, self._k = parameters.n, k
        room = parameters.room
        counts = [-(-self._n // _BRANCHES)]
        while counts[-1] > _BRANCHES:
            counts.append(-(-counts[-1] // _BRANCHES))
        self._levels = np.zeros((_LEVELS, 4), np.uint32)
        self._levels[: len(counts), 1] = counts
        self._levels[: len(counts), 0] = np.cumsum([0, *counts[:-1]])
        self._top = len(counts) - 1
        self.allocate(
            {
                "means": 12 * room, "counts": 16, "sample": 12 * _SAMPLE, "codes": 4 * room, "high_codes": 4 * room,
                "order": 4 * room, "points": 16 * room, "boxes": 32 * (room // 7 + _LEVELS), "found": 4 * k * room,
                **self._sort_sizes(room),
            }
        )  # fmt: skip

    def run(self) -> NDArray[np.int32]:
        """Return the `k` nearest other Gaussians of each, the nearest first, shape [N, k]."""
        scene = self._scene()
        n_groups = -(-self._n // 128)
        every = self._constants_of(scene)
        self.write("counts", np.array([self._n, 0, 0, 0], np.uint32))

        def step(kernel: str, names: Sequence[str]) -> Dispatch:
            return self._step("search", kernel, every, names, n_groups)

        steps = [step("search_codes", ["means", "codes", "high_codes"])]
        steps += self._sort("search", 0, "codes", None, 30, None, self._n)
        order = self._sorted[1]
        steps.append(step("search_permute", ["high_codes", order, "codes"]))
        steps += self._sort("search", 0, "codes", order, 30, "order", self._n)
        steps.append(step("search_points", ["means", "order", "points"]))
        for level in range(self._top + 1):
            n_boxes = int(self._levels[level, 1])
            settings = self._constants_of(scene, end=n_boxes, level=level)
            steps.append(self._step("search", "search_boxes", settings, ["points", "boxes"], -(-n_boxes // 128)))
        self._submit(steps)
        for first in range(0, self._n, _QUERIES):
            end = min(first + _QUERIES, self._n)
            settings = self._constants_of(scene, first, end, self._top)
            names = ["points", "boxes", "found"]
            self._submit([self._step("search", "search_nearest", settings, names, -(-(end - first) // 64))])
        return self.read("found", (self._n, self._k), np.int32)

    def _scene(self) -> NDArray[np.float32]:
        """Return the scale of the scene and its middle, robust against outliers; shape [4]."""
        n_sample = min(self._n, _SAMPLE)
        settings = self._constants_of(np.zeros(4, np.float32), end=n_sample, stride=self._n // n_sample)
        self._submit([self._step("search", "search_sample", settings, ["means", "sample"], -(-n_sample // 128))])
        sample = self.read("sample", (n_sample, 3)).astype(np.float64)
        center = np.median(sample, axis=0)
        scale = np.quantile(np.abs(sample - center).max(axis=1), 0.5)
        found = np.array([scale, *center], np.float32)
        found[0] = max(found[0], np.finfo(np.float32).tiny)  # all at one place
        return found

    def _constants_of(
        self, scene: NDArray[np.float32], first: int = 0, end: int = 0, level: int = 0, stride: int = 0
    ) -> Any:
        """Return the constants of search.wgsl."""
        integers = np.array([self._n, first, end, level, stride, 0], np.uint32)
        values = np.concatenate([integers, scene.view(np.uint32), np.zeros(2, np.uint32), self._levels.reshape(-1)])
        return self._constants(*values.tolist())

    def _submit(self, steps: list[Dispatch]) -> None:
        encoder = self.gpu.device.create_command_encoder()
        encode(encoder, steps, None)
        self.gpu.device.queue.submit([encoder.finish()])
