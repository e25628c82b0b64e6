"""What polishing does to objects, and for how long: ``python -m benchmarks.polished_objects PROJECT [--out FILE.md]``.

PROJECT is our museum room, trained, with its exhibits isolated by their words, as `make demo` leaves it. Each object is
rendered alone and compared with the true masks of the photos held out from training.

example: python -m benchmarks.polished_objects out/museum_room/project
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch

from engine.cameras import undistort
from engine.evaluation import read_ground_truth, write_section
from engine.events import never_stop
from engine.gaussians import load_gaussians
from engine.objects import View, Views, eroded, list_objects, load_membership, polish
from engine.objects.settings import BETTER
from engine.photos import load_pixels
from engine.pictures import Scene
from engine.project_folder import ProjectFolder
from engine.scene import Camera, Gaussians, read_camera_set

_SCENE = Path(__file__).parent.parent / "demo" / "museum_room"
_STEPS = (0, 25, 50, 100, 200, 400, 800)
_FEWEST_PIXELS = 200
_IN_FRONT = 0.25
_RIM = 2
_INTRODUCTION = """# Objects alone, before and after polishing

Each object, found by its word, is rendered without the rest of the scene in the photos that training did not see, 480
pixels wide. In percent of its true mask's pixels:

- beyond: how much the object alone covers beside its true mask, a pixel that is half covered counting half; not where
  the scene has something that is nearer by more than a quarter of its radius: that may well hide it.
- missing: true pixels that it covers by half or less. What its word did not bring, polishing cannot bring either.
- shines through: how much of what is behind it arrives, the mean over true pixels that are more than 2 pixels from the
  mask's edge. An hourglass has glass.
- PSNR: over black, with the photo, over those pixels.

Views that the words were found in are rendered already; CPU seconds are of polishing alone, one thread, reading nothing
from the disk. What is beyond and what shines through go on falling with more steps, but by little: 200 are the
default."""
_HEAD = "| --- | ---: | ---: | ---: | ---: | ---: |"


@dataclass(frozen=True)
class Figures:
    """Of one object, see the introduction."""

    beyond: float
    missing: float
    shines_through: float
    psnr: float
    cpu_seconds: float

    @classmethod
    def mean(cls, several: Sequence[Figures]) -> Figures:
        """Return the mean of each."""
        return cls(*np.mean([list(vars(one).values()) for one in several], axis=0).tolist())

    def row(self, name: str) -> str:
        """Return a line of a table."""
        return (
            f"| {name} | {self.beyond:.1f} | {self.missing:.1f} | {self.shines_through:.1f} | {self.psnr:.1f} "
            f"| {self.cpu_seconds:.1f} |"
        )


class Room:
    """A trained scene with objects, and its truth."""

    def __init__(self, project: Path, scene: Path) -> None:
        self.cameras = read_camera_set(project / "cameras")
        self.views = Views(Scene(load_gaussians(project / "gaussians")), self.cameras, render_side=BETTER.render_side)
        self.truth = read_ground_truth(scene / "truth", [camera.photo for camera in self.cameras.cameras])
        self.photos = scene / "photos"
        record = ProjectFolder.open_existing(project).stage_record("training") or {}
        held_out = record.get("figures", {}).get("held_out") or ()
        self.held_out = [camera for camera in self.cameras.cameras if camera.photo in held_out]
        exhibit = {prompt: name for name, prompt in self.truth.prompts.items()}
        self.objects = {
            record.name: (exhibit[record.name], load_membership(project, record.id) >= record.threshold)
            for record in list_objects(project)
            if record.name in exhibit
        }

    def measure(self, name: str, n_steps: int) -> Figures:
        """Return the figures of an object polished in `n_steps`."""
        exhibit, members = self.objects[name]
        settings = replace(BETTER, polish_steps=n_steps)
        for camera in self.cameras.cameras:
            self.views.of(camera)
        started = time.process_time()
        polished = polish(self.views, members, settings, should_stop=never_stop)
        spent = time.process_time() - started
        trained = self.views.scene.gaussians[members]
        alone = trained if polished is None else replace(polished.gaussians, features=None)
        low, high = np.percentile(trained.means, [2, 98], axis=0)
        hides = _IN_FRONT * float(np.linalg.norm(high - low)) / 2
        found = [self._compare(alone, camera, exhibit, hides) for camera in self.held_out]
        mean = np.mean([one for one in found if one is not None], axis=0).tolist()
        return Figures(*mean, cpu_seconds=spent)

    def _compare(
        self, alone: Gaussians, camera: Camera, exhibit: str, hides: float
    ) -> tuple[float, float, float, float] | None:
        masks, view = self.truth.masks(camera.photo), self.views.of(camera)
        if exhibit not in masks:
            return None
        truth = view.from_photo(masks[exhibit])
        if truth.sum() < _FEWEST_PIXELS:
            return None
        alpha, depth, color = _seen(Scene(alone), view)
        hidden = _seen(self.views.scene, view)[1] < depth - hides
        inner = eroded(truth, _RIM)
        pixels = load_pixels(self.photos / camera.photo, max_side=2 * BETTER.render_side)
        photo = np.asarray(undistort(pixels, camera, view.frame, interpolation="linear"), np.float32) / 255
        error = float(((color[inner] - photo[inner]) ** 2).mean())
        return (
            100 * float(alpha[view.within & ~truth & ~hidden].sum() / truth.sum()),
            100 * float((truth & (alpha <= 0.5)).sum() / truth.sum()),
            100 * float((1 - alpha[inner]).mean()),
            -10 * float(np.log10(error)),
        )


def _seen(scene: Scene, view: View) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return alpha, mean depth and colour over black."""
    rendered = scene.render(view.frame, color=True, channels=scene.depth_of(view.frame)[:, None])
    depth = rendered.channels[..., 3] / np.maximum(rendered.alpha, 1e-3)
    return rendered.alpha, depth, rendered.channels[..., :3]


def main() -> None:
    """Measure, print and, if wanted, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("project", type=Path, help="our museum room, trained, with objects")
    parser.add_argument("--out", type=Path, help="Markdown file for the tables")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    room = Room(arguments.project, _SCENE)
    room.measure(next(iter(room.objects)), 2)  # compiles
    figures = {n_steps: {name: room.measure(name, n_steps) for name in room.objects} for n_steps in _STEPS}
    columns = "beyond | missing | shines through | PSNR dB | CPU s |"
    by_steps = [f"| mean of {len(room.objects)} objects, steps | {columns}", _HEAD]
    by_steps += [Figures.mean(list(of.values())).row(str(n_steps)) for n_steps, of in figures.items()]
    by_object = [f"| object | {columns}", _HEAD]
    for name in room.objects:
        before, after = figures[0][name], figures[BETTER.polish_steps][name]
        by_object += [before.row(f"{name}, as in the scene"), after.row(f"{name}, polished")]
    command = "python -m benchmarks.polished_objects out/museum_room/project"
    tables = "\n\n".join("\n".join(lines) for lines in (by_steps, by_object))
    body = f"`{command}`\n\n{tables}"
    sys.stdout.write(f"{body}\n")
    if arguments.out:
        write_section(arguments.out, introduction=_INTRODUCTION, title=_SCENE.name, body=body)


if __name__ == "__main__":
    main()
