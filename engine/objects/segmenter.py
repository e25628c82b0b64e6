"""The objects of a trained project: isolated, corrected and stored. What searches or trains is imported at its use."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from typing import Any

import numpy as np

from ..core.arrays import Float32, Mask
from ..core.errors import FormatError, ObjectError, PromptError
from ..core.events import Emit, StopCheck, Warned
from ..core.settings import to_dict
from ..pictures import encode_png
from ..project.folder import ProjectFolder
from ..project.objects import (
    EVIDENCE_FILE,
    PICTURE_FILE,
    ObjectRecord,
    delete_object,
    detail_of,
    keep_version,
    list_objects,
    load_levels,
    load_membership,
    load_object,
    membership_in,
    new_id,
    new_name,
    save_object,
    taken_ids,
)
from ..project.own_words import OwnWords
from ..project.provenance import describe_run
from ..rasterizer import PROCESSOR, Device
from ..scene import Camera, PinholeCamera, load_detailed
from .candidate_file import cut_out, forget_candidates, load_candidate
from .context import DetectorFactory, SegmentationContext, load_context
from .evidence import evidence_of_clicks
from .found import BELOW_THRESHOLD, FoundObject, Levels, is_same
from .known_objects import BACKGROUND, found_again, stored_memberships, was_changed
from .lifting import corrected, isolate_kept
from .photos import SamFactory
from .prompts import Point, Prompt, TextPrompt, describe_prompt
from .settings import DEFAULT_THRESHOLD, MEMBER_THRESHOLD, SURE_SCORE, SegmentSettings
from .teaching import learn, teach_kept
from .votes import MaskEvidence

_MIN_LEFT = 0.05
"""Share of an object that a correction must leave: less is a rest of scattered Gaussians, not a smaller object."""


@dataclass(frozen=True)
class TextResult:
    """Objects found for one text, the best first, or the reason why there are none."""

    text: str
    records: tuple[ObjectRecord, ...] = ()
    refusal: str = ""


@dataclass(frozen=True)
class Segmenter:
    """Isolates, corrects and stores the objects of a trained project.

    All methods raise `HeritageError` when a part of the project is missing or damaged, and `Cancelled`, with nothing
    stored, when `should_stop` returns True.

    Attributes
    ----------
    project : ProjectFolder
        Open for writing.
    settings : SegmentSettings
    detector_factory, sam_factory : callable
        Called when their model is first needed.
    emit, should_stop : callable
        See `engine.core.events`.
    device : Device
        Renders the views and counts the votes.
    own_words : OwnWords or None
        The user's own vocabulary; None in a project that neither teaches nor uses it.
    """

    project: ProjectFolder
    settings: SegmentSettings
    detector_factory: DetectorFactory
    sam_factory: SamFactory
    emit: Emit
    should_stop: StopCheck
    device: Device = PROCESSOR
    own_words: OwnWords | None = None

    @cached_property
    def context(self) -> SegmentationContext:
        """The scene, which all prompts share."""
        return load_context(
            self.project, self.settings, self.detector_factory, self.sam_factory,
            device=self.device, own_words=self.own_words, emit=self.emit, should_stop=self.should_stop,
        )  # fmt: skip

    def segment(
        self, prompt: Prompt, name: str, *, again: Sequence[str | None] = (), context: SegmentationContext | None = None
    ) -> list[ObjectRecord]:
        """Store the objects that `prompt` asks for, the first as `name`, further ones as ``-2``, ``-3``...

        An object that exists, see `_same_as`, is not stored: the record of that one is returned in its place, which a
        warning says.

        Parameters
        ----------
        again : sequence of (str or None)
            As of `segment_each_text`.
        context : SegmentationContext or None
            Receives the progress; None for the segmenter's own.

        Raises
        ------
        PromptError
            When no object was found. The nearest candidates of a text are then stored
            (`engine.objects.candidate_file`).
        """
        from .refusals import remember_refusal
        from .segment import NoMatchError, find_objects

        started, asked, context = time.perf_counter(), describe_prompt(prompt), context or self.context
        try:
            found = find_objects(context.part(0, 2), prompt)
        except PromptError as error:
            message = str(error)
            if isinstance(prompt, TextPrompt):
                offered = error if isinstance(error, NoMatchError) else NoMatchError("", ())
                message = remember_refusal(
                    self.project.path, prompt.text, message, offered.candidates, context,
                    suggestions=offered.suggestions,
                )  # fmt: skip
            raise PromptError(message) from error
        if isinstance(prompt, TextPrompt):
            asked["detector"] = context.detector.name
        if again:
            found = [replace(one, id=known) for one, known in zip(found, again, strict=False) if known is not None]
        return self._store(context.part(1, 2), found, asked, name, started)

    def segment_texts(
        self, texts: Sequence[str], name: str | None, camera: Camera | PinholeCamera | None = None
    ) -> tuple[list[ObjectRecord], dict[str, str]]:
        """Store the objects of texts.

        Parameters
        ----------
        name : str or None
            Of the objects; None names them after their text.
        camera : Camera, PinholeCamera or None
            From which left and right are seen.

        Returns
        -------
        records : list of ObjectRecord
        refused : dict of str to str
            Reason by refused text, which is emitted as a warning.

        Raises
        ------
        PromptError
            When all texts are refused.
        """
        forget_candidates(self.project.path)
        results = list(self.segment_each_text({text: name or text for text in texts}, camera=camera))
        records = [record for result in results for record in result.records]
        refused = {result.text: result.refusal for result in results if result.refusal}
        if not records:
            raise PromptError(" ".join(refused.values()))
        for message in refused.values():
            self.emit(Warned(message))
        return records, refused

    def segment_each_text(
        self,
        names: Mapping[str, str],
        *,
        skip: Collection[str] = (),
        again: Mapping[str, Sequence[str | None]] | None = None,
        camera: Camera | PinholeCamera | None = None,
    ) -> Iterator[TextResult]:
        """Store the objects of each text, and yield its result then. A refused text does not end the others.

        Parameters
        ----------
        names : mapping of str to str
            Names of the objects by text.
        skip : collection of str
            Texts that were segmented before, e.g. in a run that was killed. They yield nothing.
        again : mapping of str to sequence of (str or None), optional
            By text, the ids of its objects that are made again, in the order of an earlier run: each keeps its id and
            name, and None stands for one that is not stored.
        camera : Camera, PinholeCamera or None
            From which left and right are seen.
        """
        self.learn()  # what was renamed since
        for number, (text, name) in enumerate(names.items()):
            if text in skip:
                continue
            context, same = self.context.part(number, len(names)), (again or {}).get(text, ())
            try:
                records = self.segment(TextPrompt(text, camera), name, again=same, context=context)
            except PromptError as error:
                yield TextResult(text, refusal=str(error))
            else:
                yield TextResult(text, tuple(records))

    def learn(self) -> list[str]:
        """Teach the user's own vocabulary what the stored objects have to teach, and return these words; see `learn`.

        A project that does not learn teaches nothing.
        """
        return [] if self.own_words is None else learn(self.project, self.own_words, self.context)

    def accept_candidate(self, number: int, name: str | None) -> list[ObjectRecord]:
        """Store a candidate of a refused text that the user accepted; one that is an object already is that object.

        Parameters
        ----------
        number : int
            As in `engine.objects.candidate_file.CANDIDATES`.
        name : str or None
            None names the object after the text.

        Raises
        ------
        PromptError
            When there is no candidate of this number, or the scene is another one now.
        """
        started, candidate, context = time.perf_counter(), load_candidate(self.project.path, number), self.context
        known = {record.id: record for record in list_objects(self.project.path)}.get(candidate.object_id)
        if known is not None:
            self.emit(Warned(f"This is {known.name!r}, which exists already, so no second object was stored."))
            return [known]
        camera = context.views.cameras.by_photo.get(candidate.photo)
        view = None if camera is None else context.views.of(camera)
        if view is None or (len(candidate.members), candidate.mask.shape) != (len(context.means), view.within.shape):
            raise PromptError("The scene has changed since this candidate was offered. Ask for the text again.")
        item = MaskEvidence(view, candidate.mask, 1.0, members=candidate.members, undecided=candidate.undecided)
        found = isolate_kept(context, item, candidate.graph)
        asked = describe_prompt(TextPrompt(candidate.text))
        asked |= {"detector": candidate.detector, "accepted": True}
        example = (candidate.example, candidate.detector, candidate.fingerprint)
        return self._store(context.part(1, 2), [found], asked, name or candidate.text, started, example=example)

    def refine(self, name: str, clicks: Sequence[Point], excluded: Sequence[Point]) -> ObjectRecord:
        """Correct a stored object by clicks; at least one.

        The object keeps its id and name, and loses its levels: they were versions of the old one, which is copied to
        the trash.

        Parameters
        ----------
        name : str
            Name or id of the object.
        clicks, excluded : sequence of Point
            On what to add, and on what to remove.

        Raises
        ------
        ObjectError
            When there is no such object, or it belongs to an earlier training.
        PromptError
            When a click hits no Gaussian, or nothing of the object would remain.
        """
        record, context = load_object(self.project.path, name), self.context
        before = membership_in(self.project.path, record, len(context.means))
        membership = corrected(context, evidence_of_clicks(clicks, excluded, context), before)
        n_left, n_before = (int((one >= record.threshold).sum()) for one in (membership, before))
        if n_left < max(1.0, _MIN_LEFT * n_before):
            raise PromptError(f"Nothing would be left of {record.name!r}, so it was not changed. Click elsewhere.")
        correction = {"clicks": [asdict(one) for one in clicks], "not": [asdict(one) for one in excluded]}
        changed = replace(record, level=0, levels=(), refined=(*record.refined, correction))
        return self._replace(changed, membership, why="corrected")

    def choose_level(self, name: str, level: int) -> ObjectRecord:
        """Replace a stored object by its level number `level`, with detail from the photos; 0 is the smallest part.

        An object without levels has level 0 alone.

        Raises
        ------
        ObjectError
            When there is no such object or level, or the object belongs to an earlier training.
        """
        from .detailing import keep_with_detail

        record = load_object(self.project.path, name)
        levels = load_levels(self.project.path, record.id)
        if not 0 <= level < len(levels):
            available = "only one level" if len(levels) == 1 else f"levels 0 to {len(levels) - 1}"
            raise ObjectError(f"{record.name!r} has {available}, and no level {level}.")
        membership_in(self.project.path, record, len(self.context.means))
        kept = list(levels) if record.levels else []
        changed = replace(record, level=level)
        return keep_with_detail(self.project, self.context, changed, levels[level], kept, "another level")

    def detail(self, names: Sequence[str] = ()) -> list[ObjectRecord]:
        """Give stored objects detail from the photos and return their records.

        What was stored before a cancel stays. An object with the detail of its present Gaussians is not detailed again.

        Parameters
        ----------
        names : sequence of str
            Names or ids; empty for every object but the background.

        Raises
        ------
        ObjectError
            When there is no such object or none at all, it is the background, or belongs to an earlier training.
        """
        from .detailing import detail_objects

        return detail_objects(self.project, self.context, names)

    def _replace(self, record: ObjectRecord, membership: Float32, *, why: str) -> ObjectRecord:
        """Store a changed object, with the detail of what it keeps. The old one is copied to the trash."""
        members = membership >= record.threshold
        detailed = detail_of(load_detailed(self.project.path, record.id), members)
        keep_version(self.project, record.id, why=why)
        kept = None if detailed is None else record.detail
        changed = replace(record, n_gaussians=int(members.sum()), detail=kept)
        save_object(self.project.path, changed, membership, detailed=detailed)
        return changed

    def segment_everything(self) -> tuple[list[ObjectRecord], list[str], ObjectRecord]:
        """Store every object of the scene that is not stored yet, and the background.

        Returns
        -------
        records : list of ObjectRecord
            New objects in descending order of score.
        known : list of str
            Ids of those that were found again and stay unchanged.
        background : ObjectRecord

        Raises
        ------
        PromptError
            When the scene contains nothing but background.
        """
        from .segment import find_everything

        started = time.perf_counter()
        found = find_everything(self.context.part(0, 2))
        existing = stored_memberships(self.project.path, len(self.context.means))
        if not found and not existing:
            raise PromptError("No object was found in front of the background of this scene. Click on an object.")
        new: list[FoundObject] = []
        kept: dict[str, None] = {}
        stored = {key: one >= MEMBER_THRESHOLD for key, one in existing.items()}
        for number, item in enumerate(found, start=1):
            same = [key for key, members in stored.items() if is_same(item.members, members)]
            kept |= dict.fromkeys(same)
            if not same:
                new.append(replace(item, name=item.name or f"object {number}"))
        records = self._store(self.context.part(1, 2), new, {"kind": "all"}, "", started)
        return records, list(kept), self.store_background()

    def store_background(self) -> ObjectRecord:
        """Store the Gaussians that belong to no object as one more; an earlier background goes to the trash.

        Raises
        ------
        ObjectError
            When the scene has no objects.
        """
        from ..training import load_gaussians

        started = time.perf_counter()
        self.project.require_intact("training")
        memberships = stored_memberships(self.project.path, len(load_gaussians(self.project.path / "gaussians")))
        if not memberships:
            raise ObjectError(
                "This scene has no objects yet, so everything would be background. Isolate one, or use --all."
            )
        highest = np.maximum.reduce(list(memberships.values()))
        # 1 - m. At exactly the threshold a Gaussian belongs to the object only, never to both.
        membership = np.where(highest >= MEMBER_THRESHOLD, np.minimum(1 - highest, BELOW_THRESHOLD), 1 - highest)
        for record in list_objects(self.project.path):
            if record.prompt.get("kind") == BACKGROUND:
                delete_object(self.project, record.id, why="replaced by a new background")
        background = FoundObject(Levels((membership.astype(np.float32),)))
        record = self._record(background, {"kind": BACKGROUND}, BACKGROUND, started)
        save_object(self.project.path, record, background.membership)
        return record

    def _store(
        self,
        context: SegmentationContext,
        found: Sequence[FoundObject],
        asked: dict[str, Any],
        name: str,
        started: float,
        *,
        example: tuple[Float32, str, str] | None = None,
    ) -> list[ObjectRecord]:
        """Store objects, each under a name of its own, and return their records.

        One without an id that has exactly the Gaussians of a stored object is that object. `example` is what is known
        of one new object: what it teaches, and name and fingerprint of the detector that described it.
        """
        names = {record.id: record.name for record in list_objects(self.project.path)}
        shown = [item.membership >= DEFAULT_THRESHOLD for item in found]
        existing = [None if item.id else self._same_as(one, asked) for item, one in zip(found, shown, strict=True)]
        context.tell(1.0, "Storing")
        records = []
        for item, one, same in zip(found, shown, existing, strict=True):
            if same is not None:
                self.emit(Warned(found_again(item.name or name, same, int(one.sum()))))
                records.append(same)
                continue
            suggested = {"name": item.name} if item.name else {}
            record = self._record(item, {**asked, **suggested}, item.name or name, started)
            if item.id:
                record = replace(record, id=item.id, name=names.get(item.id, record.name))
            pictures: dict[str, bytes] = {}
            for best in item.evidence[:1]:
                mask = best.view.to_photo(best.mask)
                pictures[EVIDENCE_FILE] = encode_png(mask)
                if "text" in asked and item.score < SURE_SCORE:
                    # A name that may be wrong is shown beside what it names.
                    pictures[PICTURE_FILE] = encode_png(cut_out(context.photos.picture(best.view), mask))
            levels = item.levels.memberships
            save_object(self.project.path, record, item.membership, levels=levels, pictures=pictures)
            records.append(record)
        if example is None or not len(example[0]):
            self.learn()
        elif self.own_words is not None:
            teach_kept(self.project, self.own_words, records[0], *example)
        return records

    def _same_as(self, members: Mask, asked: dict[str, Any]) -> ObjectRecord | None:
        """Return the object of exactly these Gaussians, bool [N], or nearly these if asked for so and changed since."""
        count = int(members.sum())
        for record in list_objects(self.project.path):
            counts = (record.n_scene_gaussians, count if was_changed(record, asked) else record.n_gaussians)
            if record.prompt.get("kind") == BACKGROUND or counts != (len(members), count):
                continue
            # A damaged object equals none; what reads it says so.
            with contextlib.suppress(FormatError):
                stored = load_membership(self.project.path, record.id) >= record.threshold
                if np.array_equal(stored, members) or (was_changed(record, asked) and is_same(stored, members)):
                    return record
        return None

    def _record(self, item: FoundObject, prompt: dict[str, Any], name: str, started: float) -> ObjectRecord:
        """Return the record of a new object, with an id and a name that no other object of the project has."""
        counts = [int((level >= DEFAULT_THRESHOLD).sum()) for level in item.levels.memberships]
        evidence = [{"photo": one.view.camera.photo, "score": one.score} for one in item.evidence]
        several, path = len(counts) > 1, self.project.path
        return ObjectRecord(
            id=new_id(name, taken_ids(path)),
            name=new_name(name, [record.name for record in list_objects(path)]),
            prompt=prompt,
            threshold=DEFAULT_THRESHOLD,
            score=item.score,
            fit=item.fit,
            n_gaussians=counts[item.levels.chosen],
            n_scene_gaussians=len(item.membership),
            evidence=tuple(evidence),
            settings=to_dict(self.settings),
            seconds=time.perf_counter() - started,
            created=datetime.now(UTC).isoformat(timespec="microseconds"),
            level=item.levels.chosen if several else 0,
            levels=tuple({"n_gaussians": count} for count in counts) if several else (),
            run=describe_run(),
        )
