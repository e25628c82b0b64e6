"""How well words find the museum room's exhibits: ``python -m benchmarks.text_prompts PROJECT [--out FILE.md]``.

PROJECT is the default photo set, trained: what `make demo` leaves in out/museum_room/project. Every exhibit is asked
for by its name, and so are things that are not there. The truth is that of the scene the photos were rendered from.

example: python -m benchmarks.text_prompts out/museum_room/project
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from engine.cameras.storage import read_camera_set
from engine.errors import PromptError
from engine.events import ignore_events, never_stop
from engine.gaussians.storage import load_gaussians
from engine.grounding.default import load_default_detector
from engine.masks.sam import load_default_sam
from engine.objects.prompts import TextPrompt
from engine.objects.segment import find_objects, label_maps_of
from engine.objects.settings import BETTER, SegmentSettings
from engine.objects.views import Views
from engine.pictures.scene import Scene
from engine.project_folder import atomic_write

_ROOM = Path(__file__).parent.parent / "demo" / "museum_room"
_NOT_THERE = (
    "guitar", "piano", "dog", "bicycle", "umbrella", "lamp", "laptop", "banana", "pillow", "wall clock", "bookcase",
    "candle", "sword", "helmet", "car", "teddy bear",
)  # fmt: skip


_INTRODUCTION = """# Words and what they find

Written by `python -m benchmarks.text_prompts out/museum_room/project --out docs/text_prompts.md`, after `make demo`.
The offline vocabulary (EfficientNet-Lite2, MiniLM) on SAM's segments; the first word of a process loads the models and
classifies the segments of eight photos. Thresholds were chosen on this very room: on others expect less.
"""
_HEAD = """| word | first object (mean IoU) | right | objects | confidence | CPU s | wall s |
| --- | --- | --- | ---: | ---: | ---: | ---: |"""


@dataclass(frozen=True)
class Answer:
    """What one word brought.

    Attributes
    ----------
    word : str
    found : str
        The exhibit that the first object is, ``something else``, or empty when the word was refused.
    iou : float
        Mean over all photos that show the exhibit, of the first object with its true mask.
    n_objects : int
    score : float
    cpu_seconds, wall_seconds : float
    """

    word: str
    found: str
    iou: float
    n_objects: int
    score: float
    cpu_seconds: float
    wall_seconds: float


class Room:
    """A trained museum room and its truth."""

    def __init__(self, project: Path) -> None:
        names = json.loads((_ROOM / "truth" / "names.json").read_text(encoding="utf-8"))
        self.names = {int(number): entry["name"] for number, entry in names.items()}
        self.cameras = read_camera_set(project / "cameras")
        self.gaussians = load_gaussians(project / "gaussians")
        self.scene = Scene(self.gaussians)
        self.label_maps = label_maps_of(project, self.cameras)

    def ask(self, word: str, settings: SegmentSettings) -> Answer:
        """Look for `word`."""
        cpu, wall = time.process_time(), time.perf_counter()
        try:
            objects = find_objects(
                self.gaussians, self.cameras, _ROOM / "photos", TextPrompt(word), settings,
                label_maps=self.label_maps, detector_factory=load_default_detector, sam_factory=load_default_sam,
                emit=ignore_events, should_stop=never_stop,
            )  # fmt: skip
        except PromptError:
            objects = []
        spent = (time.process_time() - cpu, time.perf_counter() - wall)
        if not objects:
            return Answer(word, "", 0.0, 0, 0.0, *spent)
        ious = self._ious(objects[0].membership >= 0.5)
        best = max(ious, key=lambda number: ious[number])
        found = self.names[best] if ious[best] >= 0.3 else "something else"
        return Answer(word, found, ious[best], len(objects), objects[0].score, *spent)

    def _ious(self, members: np.ndarray) -> dict[int, float]:
        """Return the mean IoU of a set of Gaussians with every exhibit, over eight photos spread over the room."""
        views = Views(self.scene, self.cameras, render_side=480)
        sums: dict[int, list[float]] = {number: [] for number in self.names}
        for camera in self.cameras.cameras[::6]:
            view = views.of(camera)
            shown = views.visible_share(view, members) > 0.5
            with Image.open(_ROOM / "truth" / "masks" / f"{Path(camera.photo).stem}.png") as file:
                truth = view.labels_from_photo(np.asarray(file, np.int32))
            for number, values in sums.items():
                mask = truth == number
                if mask.sum() >= 100:
                    values.append(float((shown & mask).sum() / (shown | mask).sum()))
        return {number: float(np.mean(values)) if values else 0.0 for number, values in sums.items()}


def rows(answers: list[Answer], there: bool) -> Iterator[str]:
    """Yield the lines of a table."""
    for a in answers:
        right = (a.found == a.word) if there else a.n_objects == 0
        found = f"{a.found} ({a.iou:.2f})" if a.n_objects else "refused"
        yield (
            f"| {a.word} | {found} | {'yes' if right else '**no**'} | {a.n_objects} | {a.score:.2f} "
            f"| {a.cpu_seconds:.0f} | {a.wall_seconds:.0f} |"
        )


def main() -> None:
    """Ask, print and, if wanted, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("project", type=Path, help="the museum room, trained")
    parser.add_argument("--out", type=Path, help="Markdown file for the tables")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    room, text = Room(arguments.project), _INTRODUCTION
    there = list(room.names.values())
    ways = (
        ("As it is", BETTER),
        ("Without looking again from all sides", replace(BETTER, n_rescored=0, least_score=0.0)),
    )
    for title, settings in ways:
        found = [room.ask(word, settings) for word in there]
        missing = [room.ask(word, settings) for word in _NOT_THERE]
        n_right = sum(a.found == a.word for a in found)
        n_refused = sum(a.n_objects == 0 for a in missing)
        text += f"\n## {title}\n\n{n_right} of {len(found)} exhibits right, {n_refused} of {len(missing)} things that "
        text += "are not there refused.\n\n"
        text += "\n".join([_HEAD, *rows(found, True), *rows(missing, False)]) + "\n"
        sys.stdout.write(text.split("\n## ")[-1])
        sys.stdout.flush()
    if arguments.out:
        with atomic_write(arguments.out) as stream:
            stream.write(text.encode())


if __name__ == "__main__":
    main()
