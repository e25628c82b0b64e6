"""Which proposals are the objects of a scene, which answer a word or are offered for it, and whole versions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csr_matrix
from scipy.special import logit

from ..core.arrays import Float32, Float64, Mask
from .context import SegmentationContext
from .found import MAX_COMMON, is_same
from .looks import Looks, kept_looks, load_or_build_looks
from .proposals import choose_sets, gains_of
from .settings import SegmentSettings

N_OFFERED = 8
"""Objects that a refused text is answered with, as pictures."""

_NEAR_ODDS = 2.0  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Of versions of an object whose log-odds for a word differ by at most this, the likeliest whole one is offered."""

_STORED_ODDS = 3.0  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Log-odds that what is stored already loses: it has a name, so that another word is rarely meant for it."""

_SIMILAR_IOU = 0.6  # chosen on museum_room, room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""IoU above which a larger proposal may be an object with a part that the smaller one lacks."""

_ABOUT_AS_LIKELY = 0.5  # chosen on museum_room, room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Log-odds by which the larger one may be less likely: the foot of a goblet is seen by fewer photos than its cup."""

_OBJECTS = "objects"
"""Name in `SegmentationContext.kept`."""

_LEAST_SCORE = 1e-9
"""Scores are clipped to this and to one minus this: finite log-odds."""


def objects_of(looks: Looks) -> list[int]:
    """Return the proposals that are the objects of the scene, as a whole, the likeliest first.

    Of the proposals, those are chosen that do not overlap and have the largest sum of gains (`gains_of`); of each, its
    largest version that is about as likely.
    """
    return whole_versions(looks, choose_sets(looks.members, gains_of(looks.odds)))


def scene_objects(context: SegmentationContext) -> Mask:
    """Return the Gaussians of `objects_of`, [K, N], made once. Raises `Cancelled` when that is stopped."""

    def find() -> Mask:
        looks = load_or_build_looks(context)
        return looks.members[objects_of(looks)]

    return context.once(_OBJECTS, find)


def kept_objects(context: SegmentationContext) -> Mask | None:
    """Return `scene_objects` of a scene that was looked at before; None where that would have to be done."""
    if _OBJECTS not in context.kept and kept_looks(context) is None:
        return None
    return scene_objects(context)


def answers_of(looks: Looks, scores: Float64, settings: SegmentSettings) -> list[tuple[int, float]]:
    """Return the proposals that a word names, each with the score of the object, the best first; empty for none.

    Parameters
    ----------
    scores : array of shape [K], float64
        Of the proposals for the word.
    """
    members = looks.members
    # The best first, without versions of better ones.
    different: list[int] = []
    for number in np.argsort(-scores, kind="stable"):
        same = (is_same(members[number], members[k]) for k in different)
        if len(different) < settings.max_objects and not any(same):
            different.append(int(number))
    least = max(settings.least_score, settings.relative_score * float(scores.max(initial=0)))
    wanted, found = [number for number in different if scores[number] >= least], []
    for number in wanted:
        # Of its versions that score nearly as much, the likeliest whole object; none that is also another answer.
        near = np.flatnonzero(scores >= settings.relative_score * scores[number])
        versions = [k for k in near if [one for one in wanted if is_same(members[k], members[one])] == [number]]
        found.append((int(max(versions, key=lambda k: float(looks.odds[k]))), float(scores[number])))
    whole = whole_versions(looks, [number for number, _ in found])
    return [(number, score) for number, (_, score) in zip(whole, found, strict=True)]


def whole_versions(looks: Looks, numbers: Sequence[int]) -> list[int]:
    """Return for each of several objects its largest version that is about as likely an object.

    What such a version adds is no object that is likelier than the version: a goblet that stands before a drum is not
    a part of it.

    Parameters
    ----------
    numbers : sequence of int
        Proposals that show different objects.

    Returns
    -------
    list of int
        Proposals of the same objects. None shows another one of `numbers` as well.
    """
    # As many products as members in common, instead of K x N for each object: scenes have up to a million Gaussians.
    sets, chosen = csr_matrix(looks.members, dtype=np.float32), np.array(numbers, np.intp)
    sizes = np.asarray(sets.sum(axis=1)).ravel()
    common = (sets[chosen] @ sets.T).toarray()
    seen = np.isin(looks.like, looks.proposal)
    alike = common > _SIMILAR_IOU * (sizes[chosen, None] + sizes - common)
    near = alike & (looks.odds >= looks.odds[chosen, None] - _ABOUT_AS_LIKELY) & seen
    same = common > MAX_COMMON * np.minimum(sizes[chosen, None], sizes)
    found = []
    for row, number in enumerate(numbers):
        versions = map(int, np.flatnonzero(near[row] & ~np.delete(same, row, axis=0).any(axis=0)))
        whole = [k for k in versions if not _adds_an_object(looks, sets, sizes, number, k)]
        found.append(max([number, *whole], key=lambda k: float(sizes[k])))
    return found


def _adds_an_object(looks: Looks, sets: csr_matrix, sizes: Float32, number: int, larger: int) -> bool:
    """Return whether what a larger version adds to a proposal is a proposal itself, and a likelier object."""
    added = looks.members[larger] & ~looks.members[number]
    common = np.asarray(sets @ added.astype(np.float32))
    alike = common > _SIMILAR_IOU * (sizes + added.sum() - common)
    return bool((alike & (looks.odds > looks.odds[larger])).any())


def offers_of(looks: Looks, scores: Float64 | None, stored: Sequence[Mask] = ()) -> list[int]:
    """Return the whole objects of a scene that a refused word may mean, at most `N_OFFERED`, the best first.

    Parameters
    ----------
    scores : array of shape [K], float64, or None
        Of the proposals for the word; None where nothing is known of it: the likeliest objects come first then.
    stored : sequence of bool arrays of shape [N]
        Objects that have a name already. They come later, and each once.
    """
    members, seen = looks.members, np.isin(looks.like, looks.proposal)
    odds = looks.odds if scores is None else logit(np.clip(scores, _LEAST_SCORE, 1 - _LEAST_SCORE))
    owner = [next((k for k, one in enumerate(stored) if is_same(one, each)), None) for each in members]
    odds = odds - _STORED_ODDS * np.array([one is not None for one in owner])
    found: list[int] = []

    def is_offered(number: int) -> bool:
        taken = {owner[other] for other in found} - {None}
        return owner[number] in taken or any(is_same(members[number], members[other]) for other in found)

    for number in map(int, np.argsort(-odds, kind="stable")):
        if not seen[number] or is_offered(number):
            continue
        near = np.flatnonzero(seen & (odds >= odds[number] - _NEAR_ODDS))
        versions = [k for k in near if is_same(members[k], members[number]) and not is_offered(int(k))]
        found.append(int(max(versions, key=lambda k: float(looks.odds[k]))))
        if len(found) == N_OFFERED:
            break
    return found
