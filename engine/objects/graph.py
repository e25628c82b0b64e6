"""The graph of a scene: Gaussians linked to their neighbours and to the segments of the photos that show them.

It is made once after training and kept. Every object is the solution of one linear system on it, see docs/objects.md.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.sparse import csr_matrix, diags, hstack
from scipy.sparse.csgraph import connected_components, reverse_cuthill_mckee

from ..core.arrays import Float32, Int32, Int64, Mask
from ..core.errors import Cancelled
from ..core.events import StopCheck
from ..core.prefetch import prefetched
from ..core.system import usable_cores
from ..scene import Camera
from .row_blocks import on_each, row_blocks
from .settings import MEMBER_THRESHOLD
from .views import OUTER, View, Views, spread_cameras
from .votes import Votes

_LEAST_PIXELS = 0.5
"""Pixels that a Gaussian contributes to a segment, from which on the two are linked. Fewer make many links that weigh
little."""

N_NEIGHBOURS = 12  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Nearest neighbours that a Gaussian is linked to."""

_PIXEL_WEIGHT = 0.02  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Weight of the link of a Gaussian to a segment, for each pixel that it contributes to it. Before any evidence, every
Gaussian is background with the weight of one pixel."""

MAX_RADII = 3.0  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Distance from the middle of an object beyond which nothing belongs, in radii that hold nine tenths of it; and from
the middle of a scene, in `Views.length_unit`."""

_SEGMENT_SIZE = 2.0  # chosen on skull66, banana16, meeting_place9, herz_jesus25, room_1, room_3, room_6, room_7
"""Size of a segment, relative to what the evidence shows, from which on its links weigh less, inversely to its size.
SAM leaves a door in the segment of its wall in one photo and not in the next, so a large segment says little of a
small object."""

LARGE = 0.5  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Pixels that show a set in a photo, relative to the photo with the most, from which on the photo shows it well."""

_LEAST_PART = 0.01  # chosen on museum_room, store_room
"""Votes of a connected part relative to those of the heaviest, from which on it belongs to an object."""

_TOLERANCE = 1e-3
"""Largest residual of a solution, relative to the right-hand side."""

_SMALLEST = np.float32(np.finfo(np.float32).tiny)
"""Smallest divisor: a solved object has no residual."""

_MAX_STEPS = 300
"""Largest number of steps of conjugate gradients."""


@dataclass(frozen=True)
class SceneGraph:
    """Links of N Gaussians with each other and with the M segments of P photos.

    Attributes
    ----------
    neighbours : sparse array of shape [N, N], float32
        Symmetric weights of the links between Gaussians.
    segments : sparse array of shape [N, M], float32
        Pixels that each Gaussian contributes to each segment.
    photo : array of shape [M], int32
        Number of the photo of each segment. Those of a photo are consecutive, and the first of them, which may be
        empty, is no segment but the rest of the photo.
    photos : tuple of str
        Names of the P photos.
    key : str
        Hash of what the graph was made of; empty if that is not known.
    """

    neighbours: csr_matrix
    segments: csr_matrix
    photo: Int32
    photos: tuple[str, ...]
    key: str = ""

    @cached_property
    def _all_pixels(self) -> Float32:
        return np.asarray(self.segments.sum(axis=1), np.float32).ravel()

    @cached_property
    def pixels(self) -> Float32:
        """Pixels with which each Gaussian votes where an object is known: its mean in a photo, at least 1; [N]."""
        return np.maximum(self._all_pixels / max(1, len(self.photos)), np.float32(1))

    @property
    def is_segment(self) -> Mask:
        """Whether each column of `segments` is a segment, not the rest of its photo, [M]."""
        return np.diff(self.photo, prepend=-1) == 0

    @cached_property
    def _order(self) -> Int32:
        """The Gaussians, [N], linked ones near each other: threads wait less for memory (Cuthill and McKee 1969)."""
        return np.asarray(reverse_cuthill_mckee(self.neighbours, symmetric_mode=True), np.int32)

    @cached_property
    def _near(self) -> csr_matrix:
        """`neighbours` in `_order`."""
        near = self.neighbours[self._order][:, self._order]
        near.sort_indices()
        return near

    @cached_property
    def _between(self) -> tuple[csr_matrix, csr_matrix]:
        """Links from Gaussians, in `_order`, to segments, [N, M], over the root of all links of a segment, and back."""
        segments = self.segments[self._order][:, np.flatnonzero(self.is_segment)]
        links = csr_matrix(_PIXEL_WEIGHT * segments, dtype=np.float32)
        roots = np.sqrt(np.maximum(np.asarray(links.sum(axis=0), np.float32).ravel(), _SMALLEST))
        links = csr_matrix(links @ diags(1 / roots), dtype=np.float32)
        return links, csr_matrix(links.T)

    def _weights(self, shown: float | Float32 | None) -> Float32:
        """Return the weights of the links of each segment beside `shown` pixels, [M, 1], or [M, K] for K of them.

        None weighs all the same.
        """
        pixels = self._segment_pixels[:, None]
        return np.ones_like(pixels) if shown is None else np.minimum(1, _SEGMENT_SIZE * shown / np.maximum(pixels, 1))

    @cached_property
    def _segment_pixels(self) -> Float32:
        """Pixels of each segment, without the rest of the photos."""
        return self._column_pixels[self.is_segment]

    @cached_property
    def _column_pixels(self) -> Float32:
        return np.asarray(self.segments.sum(axis=0), np.float32).ravel()

    def solve(
        self,
        votes: Votes,
        strictness: float | Float32,
        shown: float | Float32 | None = None,
        *,
        n_threads: int = 1,
    ) -> Float32:
        """Return the memberships of the Gaussians in K objects. Every membership falls as the strictness rises.

        Parameters
        ----------
        votes : Votes
            Of shape [N, K], or [N, 1] for one object at K values of `strictness`.
        strictness : float, or array of shape [K], float32
            Weight of a pixel beside the object relative to one inside of it, above 0.
        shown : float, array of shape [K], float32, or None
            Pixels that the evidence shows of the object, in a view. Segments of more than twice as many weigh less.
            None lets all segments weigh the same.
        n_threads : int
            Share the rows of each product; each row has the bits of one thread.

        Returns
        -------
        array of shape [N, K], float32
            0 to 1.

        Notes
        -----
        Solves (L + S + lambda B) x = S 1 for Gaussians and segments together, with the Laplacian L of the links, the
        votes S for the object and B against it, and lambda the strictness. No segment votes, so that each is the mean
        of its Gaussians by their links; put in, this leaves the Gaussians (the Schur complement), for which conjugate
        gradients need fewer steps, with the diagonal as preconditioner. SciPy's solve one system at a time, so that
        each step reads all links for one object alone.
        """
        order, neighbours, (to_segments, to_gaussians) = self._order, self._near, self._between
        weights = self._weights(shown)
        # The rows of L sum to 0: a Gaussian's links to segments, and from there back to all Gaussians.
        links = neighbours.sum(axis=1) + to_segments @ (weights * np.asarray(to_gaussians.sum(axis=1)))
        inside = votes.inside[order].astype(np.float32)
        against = _PIXEL_WEIGHT + strictness * votes.outside[order]
        degrees = (np.asarray(links) + inside + against).astype(np.float32)
        own = np.asarray(to_segments.multiply(to_segments) @ weights, np.float32)
        diagonal = np.maximum(degrees - own, _PIXEL_WEIGHT)  # it is no less; rounding can make it so
        residual = np.broadcast_to(inside, degrees.shape).copy()
        solution, scaled = np.zeros_like(degrees), np.empty_like(degrees)
        direction, product = residual / diagonal, np.empty_like(degrees)
        between = np.empty((to_gaussians.shape[0], degrees.shape[1]), np.float32)
        of_segments = row_blocks((to_gaussians,), n_threads)
        of_gaussians = row_blocks((neighbours, to_segments), n_threads)

        def gather(rows: slice, back: csr_matrix) -> None:
            np.multiply(weights[rows], back @ direction, out=between[rows])

        def multiply(rows: slice, near: csr_matrix, there: csr_matrix) -> None:
            np.multiply(degrees[rows], direction[rows], out=product[rows])
            product[rows] -= near @ direction
            product[rows] -= there @ between

        def move(rows: slice, *_: csr_matrix) -> None:
            solution[rows] += np.multiply(length, direction[rows], out=scaled[rows])
            residual[rows] -= np.multiply(length, product[rows], out=scaled[rows])
            np.divide(residual[rows], diagonal[rows], out=scaled[rows])

        def turn(rows: slice, *_: csr_matrix) -> None:
            direction[rows] *= turned
            direction[rows] += scaled[rows]

        enough, size = _TOLERANCE**2 * _dot(residual, residual), _dot(residual, direction)
        with ThreadPoolExecutor(n_threads) if n_threads > 1 else contextlib.nullcontext() as threads:
            for _ in range(_MAX_STEPS):
                if (_dot(residual, residual) <= enough).all():
                    break
                on_each(gather, of_segments, threads)
                on_each(multiply, of_gaussians, threads)
                curvature = _dot(direction, product)
                # Rounding alone makes it negative: such a column is left as it is.
                length = np.divide(size, curvature, out=np.zeros_like(size), where=curvature > _SMALLEST)
                on_each(move, of_gaussians, threads)
                before, size = size, _dot(residual, scaled)
                turned = size / np.maximum(before, _SMALLEST)
                on_each(turn, of_gaussians, threads)
        found = np.empty_like(solution)
        found[order] = np.clip(solution, 0, 1)
        return found

    def memberships(
        self,
        votes: Votes,
        strictness: float | Float32,
        shown: float | Float32 | None = None,
        *,
        n_threads: int = 1,
    ) -> Float32:
        """Return what `solve` returns, as rows, but 0 in light parts of what belongs to an object.

        Links between Gaussians connect parts. Those stay that have at least `_LEAST_PART` of the votes for the object
        that the heaviest has; all, where there are no links.

        Parameters
        ----------
        votes, strictness, shown, n_threads
            As of `solve`.

        Returns
        -------
        array of shape [K, N], float32
            0 to 1.
        """
        solved = np.ascontiguousarray(self.solve(votes, strictness, shown, n_threads=n_threads).T)
        for membership, inside in zip(solved, np.broadcast_to(votes.inside.T, solved.shape), strict=True):
            members = np.flatnonzero(membership >= MEMBER_THRESHOLD)
            if self.neighbours.nnz and len(members):
                part = connected_components(self.neighbours[members][:, members], directed=False)[1]
                weights = np.bincount(part, weights=inside[members])
                membership[members[(weights < _LEAST_PART * weights.max())[part]]] = 0
        return solved

    def without(self, part: Literal["segments", "neighbours", "features"]) -> SceneGraph:
        """Return the graph without the links to segments, those between Gaussians, or features in their weights."""
        if part == "features":
            return replace(self, neighbours=self.neighbours.sign(), key=f"{self.key} {part}")
        nothing = csr_matrix(getattr(self, part).shape, dtype=np.float32)
        return replace(self, key=f"{self.key} {part}", **{part: nothing})

    @cached_property
    def _by_photo(self) -> Float32:
        """Pixels that each Gaussian contributes to each photo, [N, P]."""
        is_of = self.photo[:, None] == np.arange(len(self.photos))
        return np.asarray(self.segments @ is_of.astype(np.float32))

    def votes_of(self, segments: Int64) -> Votes:
        """Return the votes of segments, each for the Gaussians that it shows.

        Parameters
        ----------
        segments : array of shape [K], int64
            Columns of `SceneGraph.segments`.

        Returns
        -------
        Votes
            Of shape [N, K].
        """
        inside = self.segments[:, segments].toarray().astype(np.float32)
        return Votes(inside, self._by_photo[:, self.photo[segments]] - inside)

    def shown(self, sets: csr_matrix) -> Float32:
        """Return the pixels that show each of K sets of Gaussians in each photo.

        Parameters
        ----------
        sets : sparse array of shape [K, N]

        Returns
        -------
        array of shape [K, P], float32
        """
        return np.asarray(sets @ self._by_photo, np.float32)

    def iou(self, sets: csr_matrix, others: csr_matrix) -> Float32:
        """Return the IoU, in the pixels of all photos, of sets of Gaussians with others.

        Parameters
        ----------
        sets : sparse array of shape [K, N]
        others : sparse array of shape [M, N]

        Returns
        -------
        array of shape [K, M], float32
        """
        common = (sets.multiply(self._all_pixels) @ others.T).toarray()
        union = (sets @ self._all_pixels)[:, None] + others @ self._all_pixels - common
        return np.asarray(common / np.maximum(union, _SMALLEST), np.float32)

    def outline_shares(self, members: Mask, least: float, *, by_most: bool) -> Float32:
        """Return the share of the pixels of each Gaussian that lie inside of the outlines of a set.

        The outline in a photo is the segment that fits the set best. Other photos say nothing.

        Parameters
        ----------
        members : array of shape [N], bool
        least : float
            IoU of a segment with the set, in pixels, from which on it is an outline.
        by_most : bool
            Whether half of the photos that show the set well (`LARGE`) need an outline.

        Returns
        -------
        array of shape [N], float32
            0 to 1. NaN for what other photos show more (`LARGE`), and for all where there are too few outlines.
        """
        ious, bests, wells = self._segment_ious(csr_matrix(members[None], dtype=np.float32))
        iou, best, well = ious[0], bests[0], wells[0]
        outlines = np.flatnonzero((iou >= least) & (iou == best[self.photo]))
        if by_most and (best[well] >= least).sum() < LARGE * well.sum():
            outlines = outlines[:0]
        inside = np.asarray(self.segments[:, outlines].sum(axis=1), np.float32).ravel()
        seen = self._by_photo[:, np.unique(self.photo[outlines])].sum(axis=1)
        clear = (seen > 0) & (seen >= LARGE * self._all_pixels)
        return np.divide(inside, seen, out=np.full_like(inside, np.nan), where=clear)

    def _segment_ious(self, sets: csr_matrix) -> tuple[Float32, Float32, Mask]:
        """Return the IoU, in pixels, of K sets of Gaussians with each segment, [K, M], and with the best of each photo.

        The last two are [K, P]; the third tells which photos show each set well (`LARGE`).
        """
        shown, common = self.shown(sets), np.asarray((sets @ self.segments).toarray(), np.float32)
        union = shown[:, self.photo] + self._column_pixels - common
        iou = common / np.maximum(union, _SMALLEST) * self.is_segment
        best = np.zeros_like(shown)
        np.maximum.at(best.T, self.photo, iou.T)
        return iou, best, (shown > 0) & (shown >= LARGE * shown.max(axis=1, initial=0, keepdims=True))

    def outline_agreement(self, sets: csr_matrix) -> Float32:
        """Return how well the photos' segments agree with K sets of Gaussians.

        Parameters
        ----------
        sets : sparse array of shape [K, N]

        Returns
        -------
        array of shape [K], float32
            The IoU, in pixels, of the set with the segment that fits it best, 0 to 1: the median over the photos that
            show the set well (`LARGE`). 0 for a set that no photo shows.
        """
        _, best, well = self._segment_ious(sets)
        return np.array(
            [np.median(row[seen]) if seen.any() else 0 for row, seen in zip(best, well, strict=True)], np.float32
        )


def _dot(first: Float32, second: Float32) -> Float32:
    """Return the dot products of the columns."""
    return np.einsum("nk,nk->k", first, second)


def bounded(membership: Float32, means: Float32) -> Float32:
    """Return a membership that is 0 far from its members, so that no threshold adds what is elsewhere.

    Parameters
    ----------
    membership : array of shape [N], float32
    means : array of shape [N, 3], float32
        Positions of the Gaussians.

    Returns
    -------
    array of shape [N], float32
        All 0 without members.
    """
    members = membership >= MEMBER_THRESHOLD
    if not members.any():
        return np.zeros_like(membership)
    distances = np.linalg.norm(means - np.median(means[members], axis=0), axis=1)
    return np.where(distances <= MAX_RADII * np.quantile(distances[members], 1 - 2 * OUTER), membership, np.float32(0))


def build_graph(views: Views, label_maps: Mapping[str, Int32], *, n_views: int, should_stop: StopCheck) -> SceneGraph:
    """Return the graph of a scene.

    Parameters
    ----------
    label_maps : mapping of str to array of shape [h, w], int32
        Segments by photo, at any resolution; 0 is no segment.
    n_views : int
        Number of photos, those that differ most, whose segments take part.

    Raises
    ------
    Cancelled
        When `should_stop` returns True.
    """
    with_segments = [camera for camera in views.cameras.cameras if camera.photo in label_maps]
    cameras = spread_cameras(with_segments, n_views)
    photo: list[int] = []

    def masks_of(camera: Camera) -> tuple[View, Float32]:
        view = views.of(camera)
        labels = view.labels_from_photo(label_maps[camera.photo])
        segments = np.concatenate([[0], np.unique(labels[labels > 0])])  # 0 is the rest
        masks = np.eye(len(segments), dtype=np.float32)[np.searchsorted(segments, labels)]
        return view, masks * view.within[..., None]

    def counted() -> Iterator[Float32]:
        for number, (view, masks) in enumerate(prefetched(masks_of, cameras)):
            if should_stop():
                raise Cancelled("Stopped while linking the Gaussians to the photos; no object was stored.")
            photo.extend([number] * masks.shape[2])
            yield views.scene.votes(view.frame, masks)

    # Threads prepare the masks of the next photo, link the one before, and look for neighbours.
    with ThreadPoolExecutor(1) as beside:
        neighbours = beside.submit(_neighbours, views)
        columns = [csr_matrix((len(views.scene), 0), dtype=np.float32), *prefetched(_links_by, counted())]
    segments = csr_matrix(hstack(columns))
    return SceneGraph(neighbours.result(), segments, np.array(photo, np.int32), tuple(one.photo for one in cameras))


def _links_by(votes: Float32) -> csr_matrix:
    return csr_matrix(np.where(votes >= _LEAST_PIXELS, votes, np.float32(0)))


def _neighbours(views: Views) -> csr_matrix:
    """Return links to the nearest neighbours: the cosine of the features times the root of both opacities."""
    from sklearn.neighbors import kneighbors_graph

    gaussians, directions = views.scene.gaussians, views.directions
    n_neighbours = min(N_NEIGHBOURS, len(gaussians) - 1)
    if n_neighbours < 1:
        return csr_matrix((len(gaussians), len(gaussians)), dtype=np.float32)
    links = kneighbors_graph(gaussians.means, n_neighbours, n_jobs=len(usable_cores())).tocoo()
    cosine = np.einsum("ij,ij->i", directions[links.row], directions[links.col])
    both = gaussians.opacities[links.row] * gaussians.opacities[links.col]
    links.data = (np.clip(cosine, 0, 1) * np.sqrt(both)).astype(np.float32)
    links = links.tocsr()
    return csr_matrix(links.maximum(links.T))
