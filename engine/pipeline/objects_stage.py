"""The stage ``objects`` of the pipeline: isolates what texts name, and repairs what an earlier run isolated."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

from ..core.events import Warned
from ..core.settings import to_dict
from ..objects.settings import SegmentSettings
from ..project.folder import stage_key
from ..rasterizer import PROCESSOR, Device
from .runner import StageRunner

_FOUND_BY_PROMPT = "objects_by_prompt"
"""Name in ``project.json`` of what each prompt has found so far: a killed run continues after it.

``key`` of the stage; ``found``: ids of the objects by text, and null in the place of one that existed before;
``again``: of texts whose objects were damaged, the ids of those that are made again, and null in the place of the
others; ``before``: ids of all objects when these were noted.
"""


def objects_stage(
    runner: StageRunner,
    prompts: Sequence[str],
    settings: SegmentSettings,
    *,
    sam_model: str,
    find_device: Callable[[], Device] = lambda: PROCESSOR,
) -> None:
    """Isolate what the texts `prompts` name, if any, and say which stored objects are damaged.

    Parameters
    ----------
    sam_model : str
        Name of the Segment Anything model, see `MaskSettings.model`.
    find_device : callable
        Returns what to render on; called only if the stage is not done. The key does not depend on it.
    """
    key = stage_key(runner.key_of("training"), tuple(prompts), to_dict(settings))

    def compute() -> dict[str, Any]:
        from ..masks import load_sam
        from ..objects import Segmenter
        from ..objects.grounding import load_default_detector
        from ..project.objects import object_ids

        found, again = _found_before(runner, key)
        refused: dict[str, str] = {}
        _discard_unfinished(runner, [text for text in prompts if text not in found])
        _note(runner, key, found, again)
        segmenter = Segmenter(
            runner.project, settings, load_default_detector, functools.partial(load_sam, sam_model),
            runner.emit, runner.should_stop, find_device(),
        )  # fmt: skip
        names = {prompt: prompt for prompt in prompts}
        done = tuple(text for text in found if text not in again)
        existing = set(object_ids(runner.project.path))
        same: dict[str, list[str]] = {}
        for result in segmenter.segment_each_text(names, skip=done, again=dict(again)):
            if result.refusal:
                refused[result.text] = result.refusal
                runner.emit(Warned(result.refusal))
                continue
            if again.pop(result.text, None) is None:
                # What existed before may be the user's: it is not this stage's to move to the trash.
                found[result.text] = [None if one.id in existing else one.id for one in result.records]
                if known := [one.name for one in result.records if one.id in existing]:
                    same[result.text] = known
                existing |= {one.id for one in result.records}
            _note(runner, key, found, again)
        made = {text: [one for one in ids if one is not None] for text, ids in found.items()}
        return {"found": made, "same": same, "refused": refused, "device": segmenter.device.name}

    _forget_damaged_objects(runner, key if prompts else None)
    if prompts:
        made_with = {**to_dict(settings), "prompts": list(prompts), "sam_model": sam_model}
        runner.run("objects", key, compute, settings=made_with)


def forget_found_objects(runner: StageRunner) -> None:
    """Forget which objects the prompts found, and that the stage is done."""
    runner.project.put(_FOUND_BY_PROMPT, None)
    runner.project.forget_stages(["objects"])


def _note(
    runner: StageRunner, key: str, found: dict[str, list[str | None]], again: dict[str, list[str | None]]
) -> None:
    from ..project.objects import object_ids

    before = object_ids(runner.project.path)
    runner.project.put(_FOUND_BY_PROMPT, {"key": key, "found": found, "again": again, "before": before})


def _discard_unfinished(runner: StageRunner, texts: Sequence[str]) -> None:
    """Move objects of `texts` that a killed run stored and did not note to the trash: the texts are isolated again."""
    from ..project.objects import discard_object, list_objects

    before = (runner.project.get(_FOUND_BY_PROMPT) or {}).get("before")
    if before is None:
        return
    for record in list_objects(runner.project.path):
        if record.id not in before and record.prompt.get("text") in texts:
            discard_object(runner.project, record.id, why="left by a run that was stopped")


def _forget_damaged_objects(runner: StageRunner, key: str | None) -> None:
    """Find damaged objects. Those that the stage with this `key` found are isolated again, each under its id and name.

    A damaged object is copied to the trash before, for what the user changed. What the user deleted is not made again.
    """
    from ..project.objects import forget_unreadable_record, is_object_intact, keep_version, object_ids

    project = runner.project
    damaged = [one for one in object_ids(project.path) if not is_object_intact(project.path, one)]
    if not damaged:
        return
    before = project.get(_FOUND_BY_PROMPT)
    found: dict[str, list[str | None]] = before["found"] if before is not None and before["key"] == key else {}
    texts = {one: text for text, ids in found.items() for one in ids if one is not None and one in damaged}
    for object_id in damaged:
        what = f"{texts[object_id]!r} is isolated again" if object_id in texts else "isolate the object again"
        runner.emit(Warned(f"A file of objects/{object_id} was damaged; {what}."))
    if not texts:
        return
    again: dict[str, list[str | None]] = dict(before.get("again", {}))
    for text in set(texts.values()):
        again[text] = [one if one in {*texts, *again.get(text, ())} else None for one in found[text]]
    # Stored first, so that a run that is killed below knows what is left to do.
    project.put(_FOUND_BY_PROMPT, {**before, "again": again})
    project.forget_stages(["objects"])
    for object_id in texts:
        keep_version(project, object_id, why="damaged")
        forget_unreadable_record(project.path, object_id)


def _found_before(runner: StageRunner, key: str) -> tuple[dict[str, list[str | None]], dict[str, list[str | None]]]:
    """Return what a killed run of this very stage found, and what is made again.

    Objects that it made with other settings go to the trash.
    """
    from ..project.objects import discard_object, object_ids

    before = runner.project.get(_FOUND_BY_PROMPT) or {"key": key, "found": {}}
    found: dict[str, list[str | None]] = before["found"]
    if before["key"] == key:
        return found, dict(before.get("again", {}))
    existing = set(object_ids(runner.project.path))
    for object_id in [one for ids in found.values() for one in ids if one is not None and one in existing]:
        discard_object(runner.project, object_id, why="isolated again with other prompts or settings")
    return {}, {}
