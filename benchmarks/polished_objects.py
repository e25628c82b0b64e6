"""Quality of polished objects and cost of polishing: ``python -m benchmarks.polished_objects PROJECT [--out FILE.md]``.

PROJECT is the trained museum room whose exhibits were isolated by text prompts; `make demo` creates it. Each object is
rendered alone and compared with the true masks of the held-out photos.

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
from engine.objects import View, Views, erode_mask, list_objects, load_membership, polish
from engine.objects.settings import BETTER
from engine.photos import load_pixels
from engine.pictures import Scene
from engine.project_folder import ProjectFolder
from engine.scene import Camera, Gaussians, read_camera_set

_SCENE = Path(__file__).parent.parent / "demo" / "museum_room"
_STEPS = (0, 25, 50, 100, 200, 400, 800)
"""Numbers of polishing steps that are compared."""

_MIN_PIXELS = 200
"""Smallest true mask that is evaluated, in pixels."""

_OCCLUDER_DISTANCE = 0.25
"""How much closer to the camera the scene must be to count as an occluder, as a fraction of the object's radius."""

_EDGE_WIDTH = 2
"""Width in pixels of the band along the edge of the true mask that is not evaluated for colour and transmittance."""

_INTRODUCTION = """# Polishing: objects before and after

Each object was found by a text prompt. It is rendered without the rest of the scene, 480 pixels wide, from the cameras
of the held-out photos. The columns beyond, missing and shines through are percentages of the pixels of its true mask:

- beyond: coverage outside of the true mask; a half-covered pixel counts half. Pixels where the scene is closer to the
  camera by more than a quarter of the object's radius do not count, because the object may be hidden there.
- missing: pixels of the true mask that the object covers by half or less. Polishing cannot add Gaussians that the
  prompt did not find.
- shines through: mean transmittance of the object over the pixels of the true mask that are more than 2 pixels from its
  edge. The hourglass is made of glass, so its value is not zero.
- PSNR: between the object rendered on black and the photo, over the same pixels.

CPU seconds are those of polishing alone, on one thread. The views are rendered before, and nothing is read from the
disk. With more steps, beyond and shines through decrease further, but only a little; the default is 200 steps."""
_HEAD = "| --- | ---: | ---: | ---: | ---: | ---: |"


@dataclass(frozen=True)
class Figures:
    """Figures of one object, see `_INTRODUCTION`."""

    beyond: float
    missing: float
    shines_through: float
    psnr: float
    cpu_seconds: float

    @classmethod
    def mean(cls, figures: Sequence[Figures]) -> Figures:
        """Return the mean of each figure over several objects."""
        return cls(*np.mean([list(vars(each).values()) for each in figures], axis=0).tolist())

    def row(self, name: str) -> str:
        """Return a row of the table."""
        return (
            f"| {name} | {self.beyond:.1f} | {self.missing:.1f} | {self.shines_through:.1f} | {self.psnr:.1f} "
            f"| {self.cpu_seconds:.1f} |"
        )


class TrainedScene:
    """A trained scene with objects, and its ground truth."""

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
        """Return the figures of an object after `n_steps` steps of polishing; 0 steps leave it as it is."""
        exhibit, members = self.objects[name]
        settings = replace(BETTER, polish_steps=n_steps)
        for camera in self.cameras.cameras:
            self.views.of(camera)
        started = time.process_time()
        polished = polish(self.views, members, settings, should_stop=never_stop)
        cpu_seconds = time.process_time() - started
        trained = self.views.scene.gaussians[members]
        alone = trained if polished is None else replace(polished.gaussians, features=None)
        low, high = np.percentile(trained.means, [2, 98], axis=0)
        occluder_distance = _OCCLUDER_DISTANCE * float(np.linalg.norm(high - low)) / 2
        by_view = [self._compare(alone, camera, exhibit, occluder_distance) for camera in self.held_out]
        mean = np.mean([figures for figures in by_view if figures is not None], axis=0).tolist()
        return Figures(*mean, cpu_seconds=cpu_seconds)

    def _compare(
        self, alone: Gaussians, camera: Camera, exhibit: str, occluder_distance: float
    ) -> tuple[float, float, float, float] | None:
        """Return beyond, missing, shines through and PSNR in one view; None if the exhibit is hardly visible there."""
        masks, view = self.truth.masks(camera.photo), self.views.of(camera)
        if exhibit not in masks:
            return None
        truth = view.from_photo(masks[exhibit])
        if truth.sum() < _MIN_PIXELS:
            return None
        alpha, depth, color = _render(Scene(alone), view)
        hidden = _render(self.views.scene, view)[1] < depth - occluder_distance
        inner = erode_mask(truth, _EDGE_WIDTH)
        pixels = load_pixels(self.photos / camera.photo, max_side=2 * BETTER.render_side)
        photo = np.asarray(undistort(pixels, camera, view.frame, interpolation="linear"), np.float32) / 255
        error = float(((color[inner] - photo[inner]) ** 2).mean())
        return (
            100 * float(alpha[view.within & ~truth & ~hidden].sum() / truth.sum()),
            100 * float((truth & (alpha <= 0.5)).sum() / truth.sum()),
            100 * float((1 - alpha[inner]).mean()),
            -10 * float(np.log10(error)),
        )


def _render(scene: Scene, view: View) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return alpha, mean depth and colour on black of a scene."""
    rendered = scene.render(view.frame, color=True, channels=scene.depth_of(view.frame)[:, None])
    depth = rendered.channels[..., 3] / np.maximum(rendered.alpha, 1e-3)
    return rendered.alpha, depth, rendered.channels[..., :3]


def main() -> None:
    """Measure and print the tables, and write them to the file given by ``--out``."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("project", type=Path, help="project of the trained museum room with objects")
    parser.add_argument("--out", type=Path, help="Markdown file for the tables")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    trained = TrainedScene(arguments.project, _SCENE)
    trained.measure(next(iter(trained.objects)), 2)  # The first call compiles kernels.
    figures = {n_steps: {name: trained.measure(name, n_steps) for name in trained.objects} for n_steps in _STEPS}
    columns = "beyond | missing | shines through | PSNR dB | CPU s |"
    by_steps = [f"| mean of {len(trained.objects)} objects, steps | {columns}", _HEAD]
    by_steps += [Figures.mean(list(by_name.values())).row(str(n_steps)) for n_steps, by_name in figures.items()]
    by_object = [f"| object | {columns}", _HEAD]
    for name in trained.objects:
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
