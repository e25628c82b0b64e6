"""Named buffers of one card, the dispatches on them, and the sums and sorts that several computations share."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.errors import EnvironmentProblem
from ...core.system import free_memory
from .adapters import Gpu, translate_card_errors
from .constants import Constants, Uniform
from .shaders import RENDERING, SCAN_BLOCK, SORT_BLOCK, Sources, kernels_of
from .submissions import Count, Dispatch, wait_until_done

STORAGE = 0x80 | 0x8 | 0x4  # STORAGE | COPY_DST | COPY_SRC of WebGPU
_UNIFORM = 0x40
_INDIRECT = 0x100

SMALLER = "render a smaller picture or fewer Gaussians, or use the CPU"
"""What to do when buffers do not fit."""

PLACES = {
    "keys_0": "totals",
    "keys_1": "gradients",
    "values_0": "sh_gradient",
    "pair_tiles": "rows",
    "pair_gaussians": "image",
}
"""Buffers that lie in the place of another one, which is written after their last use."""


class Workspace:
    """Buffers of one computation and dispatches on them.

    Parameters
    ----------
    what : str
        Name of the computation, for messages.
    n_channels, n_moving : int
        See `kernel_source`.
    shared : mapping of str to wgpu.GPUBuffer, optional
        Buffers to use in place of new ones if they are large enough, such as parameters that several frames render.
    pool : dict of str to wgpu.GPUBuffer, optional
        Buffers that hold nothing from one computation to the next. Those that are large enough are used, others replaced.

    Attributes
    ----------
    buffers : dict of str to wgpu.GPUBuffer
        They may be larger than asked for, with anything behind the part in use.
    sources : Sources
        Where the kernels are written.
    places : mapping of str to str
        Buffers that lie in the place of another one.
    """

    sources: ClassVar[Sources] = RENDERING
    places: ClassVar[Mapping[str, str]] = PLACES

    def __init__(
        self,
        gpu: Gpu,
        what: str,
        *,
        n_channels: int = 4,
        n_moving: int = 4,
        shared: Mapping[str, Any] | None = None,
        pool: dict[str, Any] | None = None,
    ) -> None:
        self.gpu = gpu
        self._what, self._n_channels, self._n_moving = what, n_channels, n_moving
        self._shared: Mapping[str, Any] = shared or {}
        self._pool: dict[str, Any] = {} if pool is None else pool
        self.buffers: dict[str, Any] = {}
        self._n_bytes: dict[str, int] = {}
        self._sorted: tuple[str, str] = ("", "")
        self._changing = Constants(gpu)

    def allocate(self, sizes: Mapping[str, int]) -> None:
        """Make a buffer for each of `sizes` in bytes, unless a shared one or one of the pool is large enough.

        Raises
        ------
        EnvironmentProblem
            If a buffer is larger than a kernel of this card can see, or memory is full.
        """
        self._check_bindings(sizes)
        places: dict[str, int] = {}
        for name, n_bytes in sizes.items():
            place = self.places.get(name, name)
            places[place] = max(16, n_bytes, places.get(place, 0))
        held = {name: one for name, one in {**self._pool, **self._shared}.items() if one.size >= places.get(name, 0)}
        new = {place: n_bytes for place, n_bytes in places.items() if place not in held}
        smaller = [self._pool.pop(place) for place in new if place in self._pool]
        if smaller:
            wait_until_done(self.gpu, smaller[0])
            smaller.clear()  # freed before larger ones are made
        self._check_memory(sum(new.values()))
        with translate_card_errors(self.gpu, SMALLER):
            for place, n_bytes in new.items():
                held[place] = self.gpu.device.create_buffer(size=n_bytes, usage=STORAGE, label=place)
                self._pool[place] = held[place]
        for name, n_bytes in sizes.items():
            self.buffers[name] = held[self.places.get(name, name)]
            self._n_bytes[name] = max(16, n_bytes)

    def _check_bindings(self, sizes: Mapping[str, int]) -> None:
        for name, n_bytes in sizes.items():
            if n_bytes > self.gpu.max_binding_bytes and name not in ("sh", "sh_gradient", "kept_sh"):
                raise EnvironmentProblem(
                    f"{self.gpu.name} lets a kernel see {self.gpu.max_binding_bytes >> 20} MiB and {self._what} "
                    f"needs {n_bytes >> 20} MiB for `{name}`; {SMALLER}."
                )

    def _check_memory(self, needed: int) -> None:
        """Refuse so many bytes before any buffer is made.

        A card with memory of its own does not tell through wgpu how much of it is free: there, the driver refuses.
        """
        free = free_memory() if self.gpu.shares_memory else None
        if free is not None and needed > free:
            raise EnvironmentProblem(
                f"{self._what} needs {needed >> 20} MiB on {self.gpu.name}, and {free >> 20} MiB of memory are free; "
                f"{SMALLER}."
            )

    @property
    def n_bytes(self) -> int:
        """Memory of all buffers."""
        return sum({id(buffer): buffer.size for buffer in self.buffers.values()}.values())

    def write(self, name: str, values: NDArray[Any]) -> None:
        """Copy an array to the buffer `name`."""
        if values.size:
            self.gpu.device.queue.write_buffer(self.buffers[name], 0, np.ascontiguousarray(values))

    def read(self, name: str, shape: Sequence[int], dtype: type = np.float32) -> NDArray[Any]:
        """Return a copy of the buffer `name` from its start on, which may be written to."""
        n_bytes = int(np.prod(shape)) * np.dtype(dtype).itemsize
        if not n_bytes:
            return np.zeros(shape, dtype)
        data = self.gpu.device.queue.read_buffer(self.buffers[name], 0, n_bytes)
        return np.frombuffer(data, dtype).reshape(shape)

    def release(self) -> None:
        """Free the buffers that nothing else uses, after which the object is useless.

        Dispatches refer to their workspace, so that without this the memory is free only when the interpreter next
        collects such cycles.
        """
        vars(self).clear()

    def _make_dispatches(self) -> None:
        """Make the buffer with the workgroups of indirect dispatches, 3 of 3 values."""
        self.buffers["dispatches"] = self.gpu.device.create_buffer(size=36, usage=STORAGE | _INDIRECT)

    def _uniform(self, n_bytes: int) -> Uniform:
        """Return a place for constants that change from run to run."""
        return self._changing.uniform(n_bytes)

    def _constants(self, *values: int) -> dict[str, Any]:
        """Return the resource of constants that stay."""
        padded = np.zeros(-(-len(values) // 4) * 4, np.uint32)
        padded[: len(values)] = values
        buffer = self.gpu.device.create_buffer_with_data(data=padded, usage=_UNIFORM)
        return {"buffer": buffer, "offset": 0, "size": padded.nbytes}

    def _step(
        self,
        stage: str,
        kernel: str,
        uniform: Uniform | dict[str, Any],
        names: Sequence[str | tuple[str, int, int]],
        n_groups: Count,
        *,
        entry: str = "main",
        indirect: int = -1,
    ) -> Dispatch:
        """Return the dispatch of `kernel` on the buffers `names`, or on (name, first byte, bytes) of a buffer."""
        pipeline = kernels_of(self.gpu).get(self.sources, kernel, entry, self._n_channels, self._n_moving)
        resources = [uniform.resource if isinstance(uniform, Uniform) else uniform]
        for item in names:
            name, first, n_bytes = (item, 0, self._bytes_of(item)) if isinstance(item, str) else item
            resources.append({"buffer": self.buffers[name], "offset": first, "size": n_bytes})
        bindings = self.gpu.device.create_bind_group(
            layout=pipeline.get_bind_group_layout(0),
            entries=[{"binding": i, "resource": resource} for i, resource in enumerate(resources)],
        )
        return Dispatch(stage, pipeline, bindings, n_groups, indirect)

    def _bytes_of(self, name: str) -> int:
        """Return how much of a buffer a kernel sees: what was asked for, or all where nothing was."""
        return self._n_bytes.get(name, self.buffers[name].size)

    def _scan(
        self, stage: str, length: int, per_block: int, values: str, n: Callable[[], int], indirect: int = -1
    ) -> list[Dispatch]:
        """Return the steps of a prefix sum of `n` values, or of the length that the card knows."""
        settings = self._constants(length, per_block)
        names = ["counts", values, "sums"]

        def groups() -> int:
            return -(-n() // SCAN_BLOCK)

        return [
            self._step(stage, "scan", settings, names, groups, entry="reduce", indirect=indirect),
            self._step(stage, "scan", settings, names, groups, indirect=indirect),
        ]

    def _sort(
        self, stage: str, length: int, keys: str, values: str | None, n_bits: int, order: str | None, n: Count
    ) -> list[Dispatch]:
        """Return the steps of a radix sort by the lowest `n_bits`; the result is in `order` and `_sorted`.

        `n` keys are sorted if `length` is 0, otherwise as many as the card counted at that place. Without `values`, the
        numbers of the keys are sorted. `_sorted` names the buffers of the sorted keys and values.
        """
        steps = []
        n_passes = -(-n_bits // 8)
        by_card = length != 0

        def groups() -> int:
            return -(-(n() if callable(n) else n) // SORT_BLOCK)

        for i in range(n_passes):
            settings = self._constants(8 * i, length, i == 0 and values is None)
            out_keys, out_values = f"keys_{i % 2}", f"values_{i % 2}"
            if order is not None and i == n_passes - 1:
                out_values = order
            indirect = (0, 3) if by_card else (-1, -1)
            steps.append(
                self._step(stage, "radix_count", settings, ["counts", keys, "digits"], groups, indirect=indirect[0])
            )
            steps += self._scan(stage, length, SORT_BLOCK, "digits", lambda: 256 * groups(), indirect[1])
            names = ["counts", keys, values or keys, "digits", out_keys, out_values]
            steps.append(self._step(stage, "radix_scatter", settings, names, groups, indirect=indirect[0]))
            keys, values = out_keys, out_values
        assert values is not None
        self._sorted = keys, values
        return steps

    def _sort_sizes(self, n: int) -> dict[str, int]:
        """Return the sizes of the buffers of `_sort` and `_scan` for `n` keys, in bytes."""
        blocks = -(-n // SORT_BLOCK)
        return {
            **{name: 4 * n for name in ("keys_0", "keys_1", "values_0", "values_1")},
            "digits": 1024 * blocks,
            "sums": 4 * -(-max(n + 1, 256 * blocks) // SCAN_BLOCK),
        }
