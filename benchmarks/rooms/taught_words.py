"""Words taught by example, and pictures for refused words: ``python -m benchmarks.rooms.taught_words ROOM ...``.

Each ROOM has a trained ``project`` and its ``truth``, as `python -m benchmarks.rooms unpack` makes them; what is
measured of it is kept there in ``taught.npz``. ``--doc FILE`` writes the tables between their marks in that document.
"""

from __future__ import annotations

import argparse
import functools
import itertools
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.sparse import csr_matrix

from engine.core.arrays import Float32, Float64
from engine.core.errors import HeritageError, PromptError
from engine.core.events import never_stop
from engine.core.files import ArraySpec, atomic_write, keep_arrays, read_kept_arrays
from engine.objects import Looks, MaskPrompt, load_context
from engine.objects.choosing import answers_of, offers_of
from engine.objects.context import SegmentationContext
from engine.objects.evidence import find_evidence
from engine.objects.grounding.offline_vocabulary import OfflineVocabulary
from engine.objects.grounding.wholeness import USUAL_FILE
from engine.objects.lifting import isolate_object
from engine.objects.looks import describe_members, load_or_build_looks
from engine.objects.settings import BETTER
from engine.pictures import write_png
from engine.project.folder import ProjectFolder, stage_key
from engine.quality.evaluation.gaussian_truth import gaussian_truth
from engine.quality.evaluation.ground_truth import GroundTruth, read_ground_truth
from engine.quality.evaluation.results import FOUND_IOU, WHOLE_IOU

from ..documents import print_table
from ..places import ROOT

_MARK = "**In sample**: constants of the method were chosen on these rooms."
_N_EXAMPLES = (1, 2, 5)
_MAX_CHOICES = 40
"""Choices of examples that are tried of one kind, for one room."""

_SPECS = {
    "members": ArraySpec("uint8", ("k", "bytes")),
    "odds": ArraySpec("float32", ("k",), finite=True),
    "like": ArraySpec("int32", ("k",)),
    "proposal": ArraySpec("int32", ("s",)),
    "described": ArraySpec("float32", ("s", "d"), finite=True),
    "iou": ArraySpec("float32", ("k", "t"), finite=True),
    "rows": ArraySpec("float32", ("r", "d"), finite=True),
    "owner": ArraySpec("int32", ("r",)),
}


@dataclass(frozen=True)
class Measured:
    """A room with T exhibits: looks of its K proposals, IoU of these with the exhibits, [K, T], and examples.

    ``rows`` [R, D] describe the exhibits ``owner`` [R], isolated by a true mask.
    """

    name: str
    truth: GroundTruth
    looks: Looks
    iou: Float32
    rows: Float32
    owner: np.ndarray

    def kinds(self) -> list[str]:
        """Return the word of each exhibit."""
        return [self.truth.prompts[name] for name in self.truth.objects]

    def examples(self, kind: str, detector: OfflineVocabulary) -> list[Float32]:
        """Return what each exhibit of a kind teaches."""
        numbers = [k for k, own in enumerate(self.kinds()) if own == kind and (self.owner == k).any()]
        return [detector.example_vectors(self.rows[self.owner == k]).mean(axis=0) for k in numbers]

    def shows_like(self, kind: str) -> bool:
        """Return whether an exhibit, or a piece of furniture, is of a kind that resembles this one."""
        shown = {*self.kinds(), *self.truth.ignored}
        like = _resembling()
        return (
            kind not in like or kind in shown or bool(shown & like[kind]) or any(kind in like.get(k, ()) for k in shown)
        )


@functools.cache
def _resembling() -> dict[str, frozenset[str]]:
    """Return what the exhibits of each kind of the random rooms look or sound like."""
    sys.path.insert(0, str(ROOT / "demo"))
    from random_rooms.catalogue import KIND_OF

    return {name: frozenset(kind.like) for name, kind in KIND_OF.items()}


def measure(room: Path, detector: OfflineVocabulary) -> Measured:
    """Return what is needed of a room, measured once."""
    context = load_context(ProjectFolder.open_existing(room / "project"), BETTER, lambda: detector, None)
    cameras = context.views.cameras
    truth = read_ground_truth(room / "truth", [one.photo for one in cameras.cameras], cameras.unregistered)
    file, recipe = room / "taught.npz", stage_key("taught 1", context.graph.key, detector.fingerprint)
    arrays = read_kept_arrays(file, recipe, _SPECS)
    if arrays is None:
        labels = gaussian_truth(context.views.scene, cameras, truth, never_stop)
        things = csr_matrix(np.stack([labels == k for k in range(len(truth.objects))]), dtype=np.float32)
        looks = load_or_build_looks(context)
        rows = [_drawn(context, truth, name) for name in truth.objects]
        arrays = {
            "members": np.packbits(looks.members, axis=1),
            **{name: getattr(looks, name) for name in ("odds", "like", "proposal", "described")},
            "iou": context.graph.iou(csr_matrix(looks.members, dtype=np.float32), things),
            "rows": np.concatenate(rows),
            "owner": np.repeat(np.arange(len(rows), dtype=np.int32), [len(one) for one in rows]),
        }
        keep_arrays(file, recipe, arrays)
    members = np.unpackbits(arrays["members"], axis=1, count=len(context.means)).astype(bool)
    n = len(arrays["proposal"])
    looks = Looks(
        members, arrays["odds"], arrays["like"], arrays["proposal"], ("",) * n,
        np.zeros((n, 2, 2), np.float32), arrays["described"],
    )  # fmt: skip
    return Measured(room.name, truth, looks, arrays["iou"], arrays["rows"], arrays["owner"])


def _drawn(context: SegmentationContext, truth: GroundTruth, name: str) -> Float32:
    """Return the descriptions of an exhibit that was isolated by its mask in the photo that shows it largest."""
    masks = {photo: truth.masks(photo).get(name) for photo in truth.photos}
    photo = max(masks, key=lambda one: 0 if masks[one] is None else int(masks[one].sum()))  # type: ignore[union-attr]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "mask.png"
        write_png(file, np.where(masks[photo], np.uint8(255), np.uint8(0)))
        found = isolate_object(context, find_evidence(MaskPrompt(photo, file), context))
    return describe_members(found.members, context)


def asked(room: Measured, scores: Float64, kind: str, detector: OfflineVocabulary | None = None) -> bool | None:
    """Return whether the first answer to a word is an exhibit of the kind; None where the word is refused.

    With a detector, what it takes for something else is no answer.
    """
    answers = answered(room, scores, kind, detector)
    return None if not answers else _is_of(room, answers[0], kind)


def answered(room: Measured, scores: Float64 | None, kind: str, detector: OfflineVocabulary | None) -> list[int]:
    """Return the proposals that answer a word, the best first; `scores` is None for an unknown one."""
    if scores is None:
        return []
    answers, looks = [number for number, _ in answers_of(room.looks, scores, BETTER)], room.looks
    if detector is None:
        return answers
    rows = {number: looks.described[looks.proposal == looks.like[number]] for number in answers}
    return [number for number in answers if not detector.fitting_word(rows[number], kind)]


def scores_of(room: Measured, kind: str, detector: OfflineVocabulary) -> Float64 | None:
    """Return the scores of the proposals for a word; None for an unknown one."""
    try:
        return room.looks.described_scores(kind, detector)
    except PromptError:
        return None


def _is_of(room: Measured, number: int, kind: str) -> bool:
    own = [k for k, word in enumerate(room.kinds()) if word == kind]
    return bool(room.iou[number, own].max(initial=0) >= FOUND_IOU)


def taught(
    rooms: Sequence[Measured], n_examples: int, detector: OfflineVocabulary, *, alone: bool, knowing: bool
) -> Iterator[tuple[str, str, bool, float, float]]:
    """Yield room, kind, whether the room shows it, and the shares of the choices of examples found and refused.

    Examples are of other rooms; unless `alone`, all other kinds that these show are taught, too, by as many examples
    or as there are. If `knowing`, what the vocabulary knows of the word is used as well. Kinds that a room does not
    show but resembles are not asked for.
    """
    words = sorted({kind for room in rooms for kind in room.kinds()})
    for room in rooms:
        known = {kind: [one for other in rooms if other is not room for one in other.examples(kind, detector)]
                 for kind in words}  # fmt: skip
        means = {kind: np.mean(found[:n_examples], axis=0) for kind, found in known.items() if found}
        for kind in words:
            choices = list(itertools.combinations(range(len(known[kind])), n_examples))
            if not choices or (kind not in room.kinds() and room.shows_like(kind)):
                continue
            others = [] if alone else [mean for word, mean in means.items() if word != kind]
            answers = []
            for choice in choices[:: -(-len(choices) // _MAX_CHOICES)]:
                own = np.mean([known[kind][k] for k in choice], axis=0, keepdims=True)
                word = kind if knowing and detector.check_prompt(kind).known else ""
                means_of_others = np.reshape(others, (-1, own.shape[1]))
                scores = room.looks.scores_of_examples(own, means_of_others, detector, word)
                answers.append(asked(room, scores, kind))
            found, refused = (sum(one is wanted for one in answers) / len(answers) for wanted in (True, None))
            yield room.name, kind, kind in room.kinds(), found, refused


def taught_table(rooms: Sequence[Measured], detector: OfflineVocabulary) -> str:
    """Return the table of words taught by example."""
    lines = [
        "| examples | other words taught | the vocabulary's knowledge | kinds asked where they are | found "
        "| another thing | refused | absent kinds asked | refused |",
        "| ---: | --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for n_examples, alone, knowing in itertools.product(_N_EXAMPLES, (True, False), (False, True)):
        rows = list(taught(rooms, n_examples, detector, alone=alone, knowing=knowing))
        shown, absent = [row for row in rows if row[2]], [row for row in rows if not row[2]]
        if not shown:
            continue  # no kind has as many examples in other rooms
        found, refused = (float(np.mean([row[k] for row in shown])) for k in (3, 4))
        others = f"{100 * float(np.mean([row[4] for row in absent])):.0f} %" if absent else "-"
        cells = [n_examples, "none" if alone else "all kinds", "used" if knowing else "not used", len(shown)]
        cells += [f"{100 * one:.0f} %" for one in (found, 1 - found - refused, refused)]
        lines.append(f"| {' | '.join(map(str, [*cells, len(absent), others]))} |")
    return "\n".join(lines)


def pictures_table(rooms: Sequence[Measured], detector: OfflineVocabulary) -> str:
    """Return the table of what refused words are answered with."""
    lines = [
        "| room | words | have a set | found | another thing | refused | of these among the pictures | of all words "
        "| after the others |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    sums = np.zeros(8, int)
    for room in rooms:
        counts = np.zeros(8, int)
        kinds = list(dict.fromkeys(room.kinds()))
        known = {kind: scores_of(room, kind, detector) for kind in kinds}
        answers = {kind: answered(room, known[kind], kind, detector) for kind in kinds}
        for kind in kinds:
            answer = _is_of(room, answers[kind][0], kind) if answers[kind] else None
            others = [room.looks.members[k] for other in kinds if other != kind for k in answers[other]]
            offered, after = (
                any(_is_of(room, number, kind) for number in offers_of(room.looks, known[kind], stored))
                for stored in ([], others)
            )
            has_set = any(_is_of(room, number, kind) for number in range(len(room.iou)))
            counts += [1, has_set, answer is True, answer is False, answer is None, offered and answer is None, offered,
                       after]  # fmt: skip
        sums += counts
        lines.append(f"| {room.name} | {' | '.join(map(str, counts))} |")
    shares = [f"{sums[k]} ({100 * sums[k] / sums[0]:.0f} %)" for k in range(8)]
    shares[0], shares[5] = str(sums[0]), f"{sums[5]} ({100 * sums[5] / max(1, sums[4]):.0f} %)"
    return "\n".join([*lines, f"| **all** | {' | '.join(shares)} |"])


class PerfectRanking:
    """A stand-in for an image-text encoder that reads the truth, with what `Looks.described_scores` asks of one.

    The score of a set for a word is its IoU with the exhibit of the kind that fits it best; for absent words it is 0.
    """

    name = "perfect ranking"

    def __init__(self, kinds: Sequence[str]) -> None:
        self._kinds = np.array(kinds)

    def score_descriptions(self, described: Float32, prompt: str) -> list[float]:
        """Return the score of each row, its IoU with the exhibits, for a word."""
        return [float(row[self._kinds == prompt].max(initial=0)) for row in described]

    def score_vocabulary(self, described: Float32) -> Float32:
        """Return the scores of absent words, of which least odds follow."""
        return np.zeros((len(described), 100), np.float32)


def ranking_table(rooms: Sequence[Measured], detector: OfflineVocabulary) -> str:
    """Return the table of what the sets allow, and of what perfect ranking and the offline vocabulary find of it."""
    lines = [
        "| room | words | have a set | a whole one | perfect ranking: found | whole | offline vocabulary: found "
        "| whole |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    sums = np.zeros(7, int)
    for room in rooms:
        counts = np.zeros(7, int)
        perfect = PerfectRanking(room.kinds())
        looks = replace(room.looks, described=room.iou[room.looks.proposal])
        for kind in dict.fromkeys(room.kinds()):
            own = [k for k, word in enumerate(room.kinds()) if word == kind]
            best = [room.iou[:, own].max(initial=0)]
            truly = answers_of(looks, looks.described_scores(kind, perfect), BETTER)
            offline = answered(room, scores_of(room, kind, detector), kind, detector)
            best += [room.iou[numbers[0], own].max() if numbers else 0 for numbers in ([k for k, _ in truly], offline)]
            counts += [1, *(value >= least for value in best for least in (FOUND_IOU, WHOLE_IOU))]
        sums += counts
        lines.append(f"| {room.name} | {' | '.join(map(str, counts))} |")
    shares = [str(sums[0]), *(f"{count} ({100 * count / sums[0]:.0f} %)" for count in sums[1:])]
    return "\n".join([*lines, f"| **all** | {' | '.join(shares)} |"])


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure the rooms and print or write the tables."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.rooms.taught_words", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("rooms", nargs="+", type=Path, metavar="ROOM", help="folder with project and truth")
    parser.add_argument("--doc", type=Path, help="document that gets the tables")
    parser.add_argument("--usual", action="store_true", help="write the usual features of rooms, in place of tables")
    options = parser.parse_args(arguments)
    detector = OfflineVocabulary()
    try:
        rooms = [measure(room, detector) for room in options.rooms]
        if options.usual:
            means = [detector.example_vectors(room.looks.described).mean(axis=0) for room in rooms]
            with atomic_write(USUAL_FILE) as stream:
                header = f"mean square roots of features of {len(rooms)} rooms, see benchmarks/rooms/taught_words.py"
                np.savetxt(stream, np.mean(means, axis=0), "%.4g", header=header)
            return 0
        tables = {
            "taught words": taught_table(rooms, detector),
            "pictures": pictures_table(rooms, detector),
            "perfect ranking": ranking_table(rooms, detector),
        }
        for part, table in tables.items():
            print_table(table, options.doc, part, _MARK)
    except HeritageError as error:
        parser.error(str(error))
    return 0


if __name__ == "__main__":
    sys.exit(main())
