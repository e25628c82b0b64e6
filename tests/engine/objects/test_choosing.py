"""Which objects a refused word is answered with: at most eight, each once, as the likeliest whole one."""

from __future__ import annotations

import numpy as np

from engine.objects.choosing import N_OFFERED, offers_of, whole_versions
from engine.objects.looks import Looks


def looks_of(members: np.ndarray, odds: list[float], seen: list[int]) -> Looks:
    count = len(members)
    return Looks(
        members, np.array(odds, np.float32), np.arange(count, dtype=np.int32), np.array(seen, np.int32),
        ("a",) * len(seen), np.zeros((len(seen), 2, 2), np.float32), np.zeros((len(seen), 4), np.float32),
    )  # fmt: skip


def test_eight_of_many_objects_are_offered_the_likeliest_of_the_word_first() -> None:
    looks = looks_of(np.eye(12, dtype=bool), list(range(1, 13)), list(range(12)))
    assert offers_of(looks, np.linspace(0.4, 0.1, 12)) == list(range(N_OFFERED)) and N_OFFERED == 8
    assert offers_of(looks, None) == list(range(11, 3, -1)), "the likeliest objects where nothing is known of the word"


def test_what_no_photo_shows_is_not_offered() -> None:
    looks = looks_of(np.eye(3, dtype=bool), [3, 2, 1], [0, 2])
    assert offers_of(looks, np.array([0.1, 0.9, 0.2])) == [2, 0] and offers_of(looks, None) == [0, 2]


def test_of_versions_of_an_object_the_likeliest_whole_one_is_offered_if_it_scores_nearly_as_much() -> None:
    part, whole, other = [1, 1, 0, 0, 0], [1, 1, 1, 0, 0], [0, 0, 0, 1, 1]
    looks = looks_of(np.array([part, whole, other], bool), [0, 2, 1], [0, 1, 2])
    assert offers_of(looks, np.array([0.30, 0.20, 0.1])) == [1, 2]
    assert offers_of(looks, np.array([0.30, 0.01, 0.1])) == [0, 2], "the whole hardly looks like it"


def test_stored_objects_are_offered_after_the_others_unless_they_look_far_more_like_the_word() -> None:
    looks = looks_of(np.eye(4, dtype=bool), [0, 0, 0, 0], [0, 1, 2, 3])
    stored = [looks.members[0], looks.members[2]]
    assert offers_of(looks, np.array([0.4, 0.3, 0.2, 0.1]), stored) == [1, 3, 0, 2]
    assert offers_of(looks, np.array([0.49, 0.3, 0.2, 0.01]), stored) == [1, 0, 2, 3], "two log-odds less than 3"
    assert offers_of(looks, None, stored) == [1, 3, 0, 2]


def test_stored_object_is_offered_once_though_parts_of_it_have_nothing_in_common() -> None:
    upper, lower, other = [1, 1, 0, 0, 0], [0, 0, 1, 1, 0], [0, 0, 0, 0, 1]
    looks = looks_of(np.array([upper, lower, other], bool), [0, 0, 0], [0, 1, 2])
    assert offers_of(looks, np.array([0.3, 0.2, 0.1])) == [0, 1, 2]
    assert offers_of(looks, np.array([0.3, 0.2, 0.1]), [np.array([1, 1, 1, 1, 0], bool)]) == [2, 0]


def test_goblet_comes_with_its_foot_if_that_is_about_as_likely_an_object() -> None:
    cup, goblet, with_pedestal, other = [1] * 7 + [0] * 7, [1] * 10 + [0] * 4, [1] * 13 + [0], [0] * 13 + [1]
    members = np.array([cup, goblet, with_pedestal, other], bool)
    assert whole_versions(looks_of(members, [2, 1.6, 1.9, 1], [0, 1, 2, 3]), [0, 3]) == [1, 3]
    assert whole_versions(looks_of(members, [2, 1.4, 1.9, 1], [0, 1, 2, 3]), [0, 3]) == [0, 3], "clearly less likely"
    assert whole_versions(looks_of(members, [2, 1.6, 1.9, 1], [0, 2, 3]), [0, 3]) == [0, 3], "no photo shows it"


def test_larger_version_does_not_take_in_another_object_that_was_found() -> None:
    vase, both, bowl = [1] * 7 + [0] * 3, [1] * 10, [0] * 7 + [1] * 3
    looks = looks_of(np.array([vase, both, bowl], bool), [2, 2, 2], [0, 1, 2])
    assert whole_versions(looks, [0, 2]) == [0, 2] and whole_versions(looks, [0]) == [1]


def test_larger_version_does_not_take_in_what_is_a_likelier_object_by_itself() -> None:
    drum, both, goblet = [1] * 7 + [0] * 3, [1] * 10, [0] * 7 + [1] * 3
    members = np.array([drum, both, goblet], bool)
    assert whole_versions(looks_of(members, [0.6, 0.7, 2.6], [0, 1, 2]), [0]) == [0]
    assert whole_versions(looks_of(members, [0.6, 0.7, 0.5], [0, 1, 2]), [0]) == [1], "a foot is less likely an object"
