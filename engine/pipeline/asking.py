"""Words that are asked of a scene while it is trained: the last checkpoint answers, and nothing is stored."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.errors import ProjectError, PromptError
from ..core.events import Emit, StopCheck
from ..core.files import path_within
from ..objects.settings import SegmentSettings
from ..project.folder import ProjectFolder
from ..project.own_words import OwnWords
from ..project.scene_questions import Answers, Found
from .runner import BEGUN

if TYPE_CHECKING:
    from ..objects import DetectorFactory, SamFactory

_STAGE = "training"


def ask_preview(
    project: ProjectFolder,
    texts: Sequence[str],
    out: Path,
    settings: SegmentSettings,
    *,
    detector_factory: DetectorFactory,
    sam_factory: SamFactory,
    own_words: OwnWords | None,
    emit: Emit,
    should_stop: StopCheck,
) -> Answers:
    """Look for what texts name in the scene as the last checkpoint of its training knows it.

    Parameters
    ----------
    project : ProjectFolder
        Only read: a run may be working on it.
    out : Path
        Folder for the pictures.
    detector_factory, sam_factory : callable
        See `SegmentationContext`.

    Raises
    ------
    ProjectError
        When the training has not begun, has no checkpoint yet, or is finished.
    HeritageError
        When a part of the project is missing or damaged.
    """
    from ..objects import (
        Photos,
        SegmentationContext,
        TextPrompt,
        Views,
        cut_out,
        find_objects,
        label_maps_of,
        photo_folder_of,
    )
    from ..pictures import Scene, write_png
    from ..scene import read_camera_set
    from ..training import gaussians_so_far

    run = _run_of(project)
    so_far = gaussians_so_far(run)
    if so_far is None:
        raise ProjectError("The scene has no shape yet that could be asked. Ask again in a minute.")
    step, gaussians = so_far
    cameras = read_camera_set(project.path / "cameras")
    context = SegmentationContext(
        Views(Scene(gaussians), cameras, render_side=settings.render_side),
        Photos(photo_folder_of(project), settings, sam_factory),
        label_maps_of(project.path, cameras), settings, detector_factory, emit, should_stop, own_words=own_words,
    )  # fmt: skip
    found: list[Found] = []
    refused: dict[str, str] = {}
    for number, text in enumerate(texts):
        try:
            objects = find_objects(context.part(number, len(texts)), TextPrompt(text))
        except PromptError as error:
            refused[text] = str(error)
            continue
        for best in (one.evidence[0] for one in objects if one.evidence):
            picture = out / f"{len(found) + 1}.png"
            write_png(picture, cut_out(context.photos.picture(best.view), best.view.to_photo(best.mask)))
            found.append(Found(text, best.view.camera.photo, picture))
    return Answers(step, tuple(found), refused)


def _run_of(project: ProjectFolder) -> Path:
    """Return the folder of the checkpoints of the training that goes on, or was stopped."""
    begun = project.get(BEGUN)
    if not (isinstance(begun, list) and len(begun) == 2 and begun[0] == _STAGE):
        raise ProjectError(
            f"{project.path} is not being trained. Words can be asked while it is; afterwards, isolate its objects."
        )
    if project.stage_is_done(_STAGE, begun[1]):
        raise ProjectError(f"The scene in {project.path} is trained now. Isolate its objects instead of asking.")
    return path_within(project.path, "checkpoints", str(begun[1])[:12])
