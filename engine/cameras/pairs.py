"""Selection of the photo pairs to match in full, by quick matching of the largest features of each photo.

See docs/design_notes/cameras.md for the measurements behind the thresholds.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from ..core.arrays import Float32
from ..core.errors import Cancelled
from ..core.events import StopCheck
from ..core.system import usable_cores
from .retrieval import similar_pairs

Pair = tuple[int, int]

EVERY_PAIR_UP_TO = 1_000
"""Photos up to which every pair is compared quickly: 135 s of CPU time for 1,000."""
_MANY_PHOTOS = 100
"""Photos from which on fewer features of each are compared."""
MIN_QUICK_MATCHES = 12
"""Mutual best matches among the largest features from which on a pair is matched in full."""
_RATIO = 0.8
"""Lowe's ratio: the distance of a match at most, relative to the second nearest descriptor."""
_MAX_PARTNERS = 40
"""Photos that a photo is matched with at most because of its quick matches."""
_PHOTOS_AT_A_TIME = 8
"""Photos that one photo is compared with in one product: 3 MB with 300 features of each."""
_SIMILAR = 60
"""Similar photos that a photo is compared with."""
_NEXT_PHOTOS = 2
"""Photos after each one, in the order of names, that it is always matched with."""


def all_pairs(count: int) -> list[Pair]:
    """Return every pair (i, j) with i < j < `count`."""
    return [(i, j) for i in range(count) for j in range(i + 1, count)]


def comparison_work(count: int) -> float:
    """Return how much is compared quickly for `count` photos at most, in pairs of photos with 600 features each."""
    every = count * (count - 1) // 2
    n_pairs = every if count <= EVERY_PAIR_UP_TO else min(every, _SIMILAR * count)
    return n_pairs * (_n_features(count) / _n_features(1)) ** 2


def _n_features(count: int) -> int:
    return 600 if count <= _MANY_PHOTOS else 300


def largest_descriptors(scales: Float32, descriptors: NDArray[np.uint8], *, photos: int) -> Float32:
    """Return the descriptors [K, 128] of the largest features, normalised to length 1.

    Parameters
    ----------
    scales : array of shape [N], float32
        Sizes of the features in pixels.
    descriptors : array of shape [N, 128], uint8
        SIFT descriptors.
    photos : int
        Number of photos. Above 100, fewer features are returned, because the number of pairs grows with its square.
    """
    selected = descriptors[largest_rows(scales, photos=photos)].astype(np.float32)
    length = np.linalg.norm(selected, axis=1, keepdims=True)
    unit: Float32 = (selected / np.maximum(length, 1.0)).astype(np.float32)
    return unit


def largest_rows(scales: Float32, *, photos: int) -> NDArray[np.intp]:
    """Return the rows [K] of the features [N] that `largest_descriptors` chooses."""
    # A stable sort, so that the result for equal scales does not depend on the sorting method.
    return np.argsort(-scales, kind="stable")[: _n_features(photos)]


def promising_pairs(
    descriptors: Sequence[Float32],
    *,
    neighbours: int,
    seed: int = 0,
    report: Callable[[float], None],
    should_stop: StopCheck,
) -> list[Pair]:
    """Return the pairs (i, j), i < j, to match in full.

    Parameters
    ----------
    descriptors : sequence of arrays of shape [K, 128], float32
        Results of `largest_descriptors`, one per photo, in the order of the photo names.
    neighbours : int
        Minimum number of partners of a photo, taken by number of quick matches.
    seed : int
        See `similar_pairs`.
    report : callable
        Receives the completed fraction, 0 to 1.

    Notes
    -----
    A quick match is a mutual best match of the given descriptors that passes Lowe's ratio test. A pair is selected
    when it has 12 quick matches (for the 40 best partners of a photo), when one photo is among the `neighbours` best
    partners of the other, or when the photos are at most two places from each other in the order of names, because
    photos are usually taken while walking around an object. A pair takes 1 ms of CPU,
    above 100 photos 0.3 ms, and matching it in full 80 ms. Up to 1,000 photos every pair is compared; above, each
    photo with the 60 most similar ones (`retrieval`).

    References
    ----------
    Wu, "Towards linear-time incremental structure from motion", 3DV 2013, section 3 (preemptive matching).
    """
    # A thread of ours for each core, and none of BLAS: its product of two photos on two threads takes 8 times the CPU
    # time on a busy computer, and its last bits depend on the number of threads.
    with threadpool_limits(1, "blas"):
        partners = _partners(descriptors, seed, report, should_stop)
    count = len(descriptors)
    kept: set[Pair] = set()
    for i in range(count):
        for rank, (negative, j) in enumerate(sorted(partners[i])[:_MAX_PARTNERS]):
            if -negative >= MIN_QUICK_MATCHES or rank < neighbours:
                kept.add((min(i, j), max(i, j)))
        kept.update((i, j) for j in range(i + 1, min(count, i + 1 + _NEXT_PHOTOS)))
    return sorted(kept)


def _partners(
    descriptors: Sequence[Float32], seed: int, report: Callable[[float], None], should_stop: StopCheck
) -> list[list[tuple[int, int]]]:
    """Return the photos that each photo is compared with, each after the negative of the quick matches with it."""
    count = len(descriptors)
    if count <= EVERY_PAIR_UP_TO:
        compared = all_pairs(count)
    else:
        compared = similar_pairs(descriptors, partners=_SIMILAR, seed=seed)
    later: list[list[int]] = [[] for _ in range(count)]
    for i, j in compared:
        later[i].append(j)

    def compare(i: int) -> list[int]:
        return quick_matches_with_each(descriptors[i], [descriptors[j] for j in later[i]])

    partners: list[list[tuple[int, int]]] = [[] for _ in range(count)]
    done = 0
    with ThreadPoolExecutor(max_workers=len(usable_cores())) as pool:
        try:
            for i, quick in enumerate(pool.map(compare, range(count))):
                for j, found in zip(later[i], quick, strict=True):
                    partners[i].append((-found, j))
                    partners[j].append((-found, i))
                done += len(quick)
                report(done / max(1, len(compared)))
                if should_stop():
                    raise Cancelled("Stopped while selecting pairs of photos. The next run continues from here.")
        finally:
            pool.shutdown(cancel_futures=True)
    return partners


class _KeptArrays(threading.local):
    """Memory of a thread, by name, which its next array of this name takes again."""

    def __init__(self) -> None:
        self._memory: dict[str, Float32] = {}

    def array(self, name: str, shape: tuple[int, ...]) -> Float32:
        """Return an array of any values."""
        size = math.prod(shape)
        if len(self._memory.get(name, ())) < size:
            self._memory[name] = np.empty(size, np.float32)
        return self._memory[name][:size].reshape(shape)


_KEPT = _KeptArrays()


def quick_matches(first: Float32, second: Float32) -> int:
    """Return the number of mutual best matches between descriptors [K, 128] that pass Lowe's ratio test."""
    return len(quick_match_rows(first, second))


def quick_matches_with_each(first: Float32, others: Sequence[Float32]) -> list[int]:
    """Return `quick_matches` of descriptors [K, 128] with those of each other photo.

    Several photos at a time: threads that compare one pair after the other wait for Python's lock most of the time.
    Each thread keeps its arrays: to give megabytes back to the system, threads wait for each other.
    """
    if len(first) < 2:
        return [0] * len(others)
    found: list[int] = []
    for start in range(0, len(others), _PHOTOS_AT_A_TIME):
        some = others[start : start + _PHOTOS_AT_A_TIME]
        count = max(2, *map(len, some))
        block = _KEPT.array("block", (len(some), count, first.shape[1]))
        for rows, one in zip(block, some, strict=True):
            rows[: len(one)], rows[len(one) :] = one, 0.0
        product = _KEPT.array("cosine", (len(first), len(some) * count))
        np.matmul(first, block.reshape(-1, first.shape[1]).T, out=product)
        cosine = product.reshape(len(first), len(some), count)
        for number, one in enumerate(some):
            cosine[:, number, len(one) :] = -1.0
        best = cosine.argmax(axis=2)[:, :, None]
        nearest = np.take_along_axis(cosine, best, axis=2)
        mutual = np.take_along_axis(cosine.max(axis=0)[None], best, axis=2) == nearest
        np.put_along_axis(cosine, best, -1.0, axis=2)
        distinct = _is_distinct(nearest[:, :, 0], cosine.max(axis=2))
        matches = (mutual[:, :, 0] & distinct).sum(axis=0)
        found += [int(matches[number]) if len(one) >= 2 else 0 for number, one in enumerate(some)]
    return found


def _is_distinct(nearest: Float32, runner_up: Float32) -> NDArray[np.bool_]:
    """Return which matches pass Lowe's ratio test, from the cosines to the nearest two descriptors."""
    # For unit vectors |a - b|^2 = 2 - 2 cosine, so the ratio of distances is squared here.
    return np.asarray((1.0 - nearest) < _RATIO**2 * (1.0 - runner_up))


def quick_match_rows(first: Float32, second: Float32) -> NDArray[np.intp]:
    """Return the rows [M, 2] of the mutual best matches between descriptors [K, 128] that pass Lowe's ratio test."""
    if len(first) < 2 or len(second) < 2:
        return np.zeros((0, 2), np.intp)
    cosine = first @ second.T
    rows = np.arange(len(first))
    best = cosine.argmax(axis=1)
    nearest = cosine[rows, best]
    # A match is mutual when it is the maximum of its column. An argmax over the columns takes five times as long.
    mutual = cosine.max(axis=0)[best] == nearest
    cosine[rows, best] = -1.0
    chosen = mutual & _is_distinct(nearest, cosine.max(axis=1))
    return np.stack([rows[chosen], best[chosen]], axis=1)
