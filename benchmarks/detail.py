"""Quality of polished objects and cost of polishing: ``python -m benchmarks.polished_objects PROJECT ...``.

PROJECT is a trained room whose exhibits were isolated by text prompts. `make demo` creates that of the museum room;
in others, ``python -m engine segment PROJECT --prompt "vase;teapot"`` isolates them. Each object is rendered alone and
compared with the true masks of the test photos. The ground truth is the folder ``truth`` beside the project, as
``python -m benchmarks.rooms unpack`` writes it, or that of the scene of the same name in ``demo``.

example: python -m benchmarks.polished_objects out/museum_room/project
         python -m benchmarks.polished_objects out/kept/room_*/project --steps 0,200 --title "choosing rooms"
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch

from engine.cameras import undistort
from engine.core.events import never_stop
from engine.objects import View, Views, erode_mask, list_objects, load_membership, polish
from engine.objects.settings import BETTER
from engine.photos import load_pixels
from engine.pictures import Scene
from engine.project.folder import ProjectFolder
from engine.quality.evaluation import read_ground_truth, write_section
from engine.quality.evaluation.settings import MARKS
from engine.scene import Camera, Gaussians, read_camera_set
from engine.training import load_gaussians

_DEMO = Path("demo")
_STEPS = (0, 25, 50, 100, 200, 400, 800)
"""Numbers of polishing steps that are compared."""

_MIN_PIXELS = 200
"""Smallest true mask that is evaluated, in pixels."""

_OCCLUDER_DISTANCE = 0.25
"""How much closer to the camera the scene must be to count as an occluder, as a fraction of the object's radius."""

_NOTICED = 0.05
"""Smallest change of PSNR, in dB, that counts as a rise or a fall: smaller ones are not seen in the table."""

_EDGE_WIDTH = 2
"""Width in pixels of the band along the edge of the true mask that is not evaluated for colour and transmittance."""

_INTRODUCTION = """# Polishing: objects before and after

Each object was found by a text prompt. It is rendered without the rest of the scene, 480 pixels wide, from the cameras
of the test photos. The columns beyond, missing and shines through are percentages of the pixels of its true mask:

- beyond: coverage outside of the true mask; a half-covered pixel counts half. Pixels where the scene is closer to the
  camera by more than a quarter of the object's radius do not count, because the object may be hidden there.
- missing: pixels of the true mask that the object covers by half or less. Polishing cannot add Gaussians that the
  prompt did not find.
- shines through: mean transmittance of the object over the pixels of the true mask that are more than 2 pixels from its
  edge. The hourglass is made of glass, so its value is not zero.
- PSNR: between the object rendered on black and the photo, over the same pixels.

CPU seconds are those of polishing alone, on one thread. The views are rendered before, and nothing is read from the
disk. The number of steps, 200, was chosen on the museum room. Polishing makes an object opaque and ends it at its edge;
it does not always make its colours more like the photos, so the first table shows every exhibit by itself."""


@dataclass(frozen=True)
class Figures:
    """Figures of one exhibit, see `_INTRODUCTION`."""

    beyond: float
    missing: float
    shines_through: float
    psnr: float
    cpu_seconds: float

    @classmethod
    def mean(cls, figures: Sequence[Figures]) -> Figures:
        """Return the mean of each figure over several objects."""
        return cls(*np.mean([list(vars(each).values()) for each in figures], axis=0).tolist())


def table_of_steps(figures: Mapping[int, Mapping[str, Figures]]) -> str:
    """Return the table of means over all exhibits, in Markdown, one row for each number of steps."""
    lines = [
        f"| mean of {len(figures[0])} exhibits, steps | beyond | missing | shines through | PSNR dB | CPU s |",
        "| --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    for n_steps, by_name in figures.items():
        mean = Figures.mean(list(by_name.values()))
        lines.append(
            f"| {n_steps} | {mean.beyond:.1f} | {mean.missing:.1f} | {mean.shines_through:.1f} | {mean.psnr:.1f} "
            f"| {mean.cpu_seconds:.1f} |"
        )
    return "\n".join(lines)


def table_of_exhibits(before: Mapping[str, Figures], after: Mapping[str, Figures]) -> str:
    """Return the table of single exhibits, in Markdown: each figure as in the scene and polished."""
    lines = [
        "| exhibit | beyond | polished | missing | polished | shines through | polished | PSNR dB | polished | change "
        "| CPU s |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for name, old in before.items():
        new = after[name]
        lines.append(
            f"| {name} | {old.beyond:.1f} | {new.beyond:.1f} | {old.missing:.1f} | {new.missing:.1f} "
            f"| {old.shines_through:.1f} | {new.shines_through:.1f} | {old.psnr:.1f} | {new.psnr:.1f} "
            f"| {new.psnr - old.psnr:+.1f} | {new.cpu_seconds:.1f} |"
        )
    return "\n".join(lines)


def summary(before: Mapping[str, Figures], after: Mapping[str, Figures]) -> str:
    """Return sentences that say for how many exhibits polishing helps and for how many it harms."""
    gains = {name: after[name].psnr - before[name].psnr for name in before}
    rises, falls = (sum(sign * gain >= _NOTICED for gain in gains.values()) for sign in (1, -1))
    best, worst = max(gains, key=lambda name: gains[name]), min(gains, key=lambda name: gains[name])
    clearer, tighter = (
        sum(getattr(after[name], figure) < getattr(before[name], figure) for name in before)
        for figure in ("shines_through", "beyond")
    )
    return (
        f"With {BETTER.polish_steps} steps, the PSNR rises for {rises} and falls for {falls} of {len(gains)} exhibits: "
        f"by {np.mean(list(gains.values())):+.1f} dB on average, between {gains[worst]:+.1f} dB ({worst}) and "
        f"{gains[best]:+.1f} dB ({best}). Less shines through {clearer} of them, and {tighter} reach less beyond their "
        "true mask."
    )


class TrainedScene:
    """A trained scene with objects, and its ground truth."""

    def __init__(self, project: Path, truth: Path) -> None:
        self.name = project.resolve().parent.name
        self.cameras = read_camera_set(project / "cameras")
        self.views = Views(Scene(load_gaussians(project / "gaussians")), self.cameras, render_side=BETTER.render_side)
        self.truth = read_ground_truth(truth, [camera.photo for camera in self.cameras.cameras])
        self.photos = truth.parent / "photos"
        record = ProjectFolder.open_existing(project).stage_record("training") or {}
        held_out = record.get("figures", {}).get("held_out") or ()
        self.held_out = [camera for camera in self.cameras.cameras if camera.photo in held_out]
        self.objects: dict[str, np.ndarray] = {}
        """Members of each exhibit that was found, bool [N]."""
        for record in list_objects(project):
            members = load_membership(project, record.id) >= record.threshold
            exhibit = self._exhibit_of(record.prompt.get("text"), members)
            if exhibit is not None:
                self.objects[exhibit] = members

    def measure(self, name: str, n_steps: int) -> Figures:
        """Return the figures of an object after `n_steps` steps of polishing; 0 steps leave it as it is."""
        members = self.objects[name]
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
        by_view = [self._compare(alone, camera, name, occluder_distance) for camera in self.held_out]
        mean = np.mean([figures for figures in by_view if figures is not None], axis=0).tolist()
        return Figures(*mean, cpu_seconds=cpu_seconds)

    def _exhibit_of(self, text: str | None, members: np.ndarray) -> str | None:
        """Return the exhibit with this text, not yet found, that an object shows best; None if there is none.

        Equal exhibits share a text. They are distinguished by the mean IoU with their true masks.
        """
        named = [name for name, prompt in self.truth.prompts.items() if prompt == text and name not in self.objects]
        if not named or not members.any():
            return None
        scene = Scene(self.views.scene.gaussians[members])
        overlaps: dict[str, list[float]] = {name: [] for name in named}
        for camera in self.held_out:
            masks, view = self.truth.masks(camera.photo), self.views.of(camera)
            shown = _render(scene, view)[0] > 0.5
            for name in set(named) & set(masks):
                true = view.from_photo(masks[name])
                overlaps[name].append(float((shown & true).sum() / max((shown | true).sum(), 1)))
        means = {name: float(np.mean(values)) for name, values in overlaps.items() if values}
        best = max(means, key=lambda name: means[name], default=None)
        return best if best is not None and means[best] > 0 else None

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
    parser.add_argument("projects", type=Path, nargs="+", help="trained projects with objects that were found by text")
    parser.add_argument("--title", help="of the section (default: the name of the room)")
    parser.add_argument(
        "--steps",
        default=",".join(map(str, _STEPS)),
        metavar="N,N",
        help=f"numbers of polishing steps, 0 and {BETTER.polish_steps} among them (default: %(default)s)",
    )
    parser.add_argument(
        "--mark", choices=tuple(MARKS), default="in sample", help="whether constants were chosen on this scene"
    )
    parser.add_argument("--out", type=Path, help="Markdown file for the tables")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    steps = [int(number) for number in arguments.steps.split(",")]
    if not {0, BETTER.polish_steps} <= set(steps):
        parser.error(f"--steps must contain 0 and {BETTER.polish_steps}, the number that is used")
    read = [TrainedScene(project, _truth_of(project)) for project in arguments.projects]
    scenes = [scene for scene in read if scene.objects]
    if not scenes:
        project, prompts = arguments.projects[0], ";".join(dict.fromkeys(read[0].truth.prompts.values()))
        raise SystemExit(
            f"{project} has no exhibit that was found by its text. "
            f'Isolate them first: python -m engine segment {project} --prompt "{prompts}"'
        )
    scenes[0].measure(next(iter(scenes[0].objects)), 2)  # The first call compiles kernels.
    figures = {
        n_steps: {
            f"{scene.name}: {name}" if len(scenes) > 1 else name: scene.measure(name, n_steps)
            for scene in scenes
            for name in scene.objects
        }
        for n_steps in steps
    }
    before, after = figures[0], figures[BETTER.polish_steps]
    options = "" if tuple(steps) == _STEPS else f" --steps {arguments.steps}"
    options += "" if arguments.title is None else f" --title '{arguments.title}'"
    options += "" if arguments.mark == "in sample" else f" --mark {arguments.mark}"
    without = [scene.name for scene in read if not scene.objects]
    body = "\n\n".join([
        f"`python -m benchmarks.polished_objects {' '.join(map(str, arguments.projects))}{options}`",
        MARKS[arguments.mark],
        summary(before, after),
        table_of_exhibits(before, after),
        table_of_steps(figures),
        *([f"No exhibit was found by its text in {', '.join(without)}."] if without else ()),
    ])  # fmt: skip
    sys.stdout.write(f"{body}\n")
    if arguments.out:
        title = arguments.title or ", ".join(scene.name for scene in scenes)
        write_section(arguments.out, introduction=_INTRODUCTION, title=title, body=body)


def _truth_of(project: Path) -> Path:
    """Return the folder with the ground truth of a project."""
    folder = project.resolve().parent
    beside, of_demo = folder / "truth", _DEMO / folder.name / "truth"
    if not beside.is_dir() and not of_demo.is_dir():
        raise SystemExit(f"{project} has no ground truth: neither {beside} nor {of_demo} is there.")
    return beside if beside.is_dir() else of_demo


if __name__ == "__main__":
    main()
