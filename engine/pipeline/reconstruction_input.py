"""What a scene was reconstructed from, as ``project.json`` keeps it, so that it can be done again with another preset.

Standard library only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..core.errors import HeritageError, ProjectError
from ..core.files import check, optional, read_after_change
from ..core.words import join_texts
from ..project.content import shown_objects
from ..project.folder import PROJECT_FILE, ProjectFolder
from ..training.settings import OFFERED_PRESETS

_NAME = "input"
_SCHEMA = {
    "photos": str,
    "cameras": optional((str, None)),
    "photo_masks": optional((str, None)),
    "mask_background": optional(bool),
    "exclude_transients": optional(bool),
    "wants_objects": optional(bool),
    "light": optional(bool),
}


@dataclass(frozen=True)
class ReconstructionInput:
    """What the user gave to a reconstruction, besides the preset and the objects.

    Attributes
    ----------
    photos : str
        Absolute path of the folder of photos, or of the video.
    cameras, photo_masks : str or None
        Absolute paths of known cameras, and of a folder of masks; None when they were estimated, or not used.
    mask_background, exclude_transients, wants_objects, light : bool
        Options ``--mask-background``, ``--transients``, (false) ``--no-objects`` and ``--light``.
    """

    photos: str
    cameras: str | None = None
    photo_masks: str | None = None
    mask_background: bool = False
    exclude_transients: bool = False
    wants_objects: bool = True
    light: bool = False


def store_input(project: ProjectFolder, given: ReconstructionInput) -> None:
    """Store what a reconstruction in `project` was given."""
    if project.get(_NAME) != asdict(given):
        project.put(_NAME, asdict(given))


def read_input(project: Path) -> ReconstructionInput:
    """Return what the scene of `project` was reconstructed from.

    Raises
    ------
    ProjectError
        When the project does not say it, or its photos are no longer there.
    FormatError
        When ``project.json`` cannot be read.
    """
    folder = ProjectFolder.open_existing(project)
    stored = folder.get(_NAME)
    if stored is None or check(stored, _SCHEMA) is not None:
        raise ProjectError(
            f"{project} does not say what its scene was made from. Import its photo folder again, with the project "
            "folder and the other options of that time."
        )
    given = ReconstructionInput(**{name: stored[name] for name in _SCHEMA if name in stored})
    for path in (given.photos, given.cameras, given.photo_masks):
        # An absolute path is never taken for an option.
        if path is not None and not (Path(path).is_absolute() and Path(path).exists()):
            raise ProjectError(
                f"{path[:200]}, from which the scene was made, is not there. Bring it back, or import the photos again."
            )
    return given


def better_preset(project: Path) -> str:
    """Return the next better preset than that of the scene of `project`; empty when there is none, or no scene."""
    offered = [preset.name for preset in OFFERED_PRESETS]
    present = _trained_preset(project)
    return offered[offered.index(present) + 1] if present in offered[:-1] else ""


@read_after_change(PROJECT_FILE)
def _trained_preset(project: Path) -> str:
    try:
        record: dict[str, Any] = ProjectFolder.open_existing(project).stage_record("training") or {}
    except HeritageError:
        return ""
    return str(record.get("figures", {}).get("preset", ""))


def repeat_arguments(project: Path, preset: str) -> list[str]:
    """Return the engine's arguments that make the scene of `project` again with another preset.

    Objects that were found by words are searched for again.

    Raises
    ------
    HeritageError
        As `read_input` and `shown_objects`.
    """
    given, texts = read_input(project), texts_of_objects(project)
    options = {"--cameras": given.cameras, "--photo-masks": given.photo_masks}
    return [
        "reconstruct", given.photos, "--out", str(project), "--preset", preset,
        *(f"{name}={path}" for name, path in options.items() if path is not None),
        *(["--mask-background"] if given.mask_background else []),
        *(["--transients"] if given.exclude_transients else []),
        *([] if given.wants_objects else ["--no-objects"]),
        *(["--light"] if given.light else []),
        *([f"--prompts={join_texts(texts)}"] if texts and given.wants_objects else []),
    ]  # fmt: skip


def texts_of_objects(project: Path) -> Sequence[str]:
    """Return the texts by which objects of `project` were found."""
    return list(dict.fromkeys(one.prompt for one in shown_objects(project) if one.kind == "text" and one.prompt))
