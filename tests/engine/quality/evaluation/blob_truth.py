"""True masks of the blob scene in our own layout, and a project of it that did not train on two of its photos."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from engine.project.folder import ProjectFolder
from tests.engine.pictures.blob_scene import BLUE, RED, TWIN, BlobScene

HELD_OUT = ("view_2.png", "view_6.png")
NAMES = {RED: "red ball", TWIN: "other red ball", BLUE: "blue ball"}


def write_truth(
    scene: BlobScene,
    folder: Path,
    *,
    names: dict[int, str] | None = None,
    prompts: dict[int, str] | None = None,
    ignored: Sequence[int] = (),
    absent: Sequence[str] = (),
    photos: Sequence[str] | None = None,
) -> Path:
    """Write true masks of the parts in `names`, and return their folder.

    `ignored` parts are not evaluated, `absent` are texts for what is not there, `photos` are those with masks.
    """
    (folder / "masks").mkdir(parents=True)
    for photo, labels in scene.labels.items():
        if photos is None or photo in photos:
            Image.fromarray(labels.astype(np.uint8)).save(folder / "masks" / photo)
    names = names or NAMES
    entries: dict[str, dict[str, object]] = {}
    for part, name in names.items():
        entries[str(part)] = {"name": name, "prompt": (prompts or names)[part]}
        if part in ignored:
            entries[str(part)]["ignore"] = True
    (folder / "names.json").write_text(json.dumps(entries), encoding="utf-8")
    if absent:
        (folder / "absent.json").write_text(json.dumps(list(absent)), encoding="utf-8")
    return folder


def held_out(project: ProjectFolder, photos: Sequence[str] = HELD_OUT) -> ProjectFolder:
    """Note in the project that training did not see `photos`."""
    with project:
        project.finish_stage("training", "k", wall_seconds=1, cpu_seconds=1, figures={"held_out": list(photos)})
    return project
