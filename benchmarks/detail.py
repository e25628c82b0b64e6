"""Quality of objects with detail and its cost: ``python -m benchmarks.detail PROJECT ...``.

PROJECT is a trained room whose exhibits were isolated by text prompts. `make demo` creates that of the museum room;
in others, ``python -m engine segment PROJECT --prompt "vase;teapot"`` isolates them. Each object is rendered alone and
compared with the true masks of the test photos, at the photos' own size. The ground truth is the folder ``truth``
beside the project, as ``python -m benchmarks.rooms unpack`` writes it, or that of the scene of the same name in
``demo``. Nothing is stored in the project.

example: python -m benchmarks.detail out/museum_room/project
         python -m benchmarks.detail out/museum_room/project --only vase --picture vase.jpg
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
from PIL import Image

from engine.cameras import training_pinhole, undistort
from engine.core.events import never_stop
from engine.objects import DetailPhotos, Views, detail_object, erode_mask
from engine.objects.settings import BETTER
from engine.photos import load_pixels
from engine.pictures import Scene
from engine.project.folder import ProjectFolder
from engine.project.objects import list_objects, load_membership
from engine.quality.evaluation import read_ground_truth, write_section
from engine.quality.evaluation.settings import MARKS
from engine.rasterizer.settings import Backend
from engine.scene import Camera, Gaussians, PinholeCamera, read_camera_set
from engine.training import load_gaussians

_DEMO = Path("demo")

_MAX_SIDE = 4096
"""Longest side, in pixels, at which a test photo is compared."""

_MIN_PIXELS = 300
"""Smallest true mask that is evaluated, in pixels."""

_OCCLUDER_DISTANCE = 0.25
"""How much closer to the camera the scene must be to count as an occluder, as a fraction of the object's radius."""

NOTICED = 0.05
"""Smallest change of PSNR, in dB, that counts as a rise or a fall: smaller ones are not seen in the table."""

EDGE_WIDTH = 2
"""Width in pixels of the band along the edge of the true mask that is not evaluated for colour and transmittance."""

_NEEDLE = 5.0
"""Ratio of the longest to the middle scale from which on a Gaussian is a needle."""


@dataclass(frozen=True)
class Figures:
    """Figures of one exhibit, see docs/detail.md."""

    beyond: float
    missing: float
    shines_through: float
    psnr: float
    sharp: float
    needles: float
    seconds: float

    @classmethod
    def mean(cls, figures: Sequence[Figures]) -> Figures:
        """Return the mean of each figure over several objects."""
        return cls(*np.mean([list(vars(each).values()) for each in figures], axis=0).tolist())


def table_of_exhibits(before: Mapping[str, Figures], after: Mapping[str, Figures], seconds: str = "CPU s") -> str:
    """Return the table of single exhibits, in Markdown: each figure as in the scene and with detail, then the mean.

    `seconds` names the last column.
    """
    lines = [
        "| exhibit | beyond | detail | missing | detail | shines through | detail | sharp | detail | needles | detail "
        f"| PSNR dB | detail | change | {seconds} |",
        "| --- |" + " ---: |" * 14,
    ]
    means = (Figures.mean(list(before.values())), Figures.mean(list(after.values())))
    for name, (old, new) in {**{name: (before[name], after[name]) for name in before}, "**mean**": means}.items():
        pairs = [
            f"{getattr(old, figure):.{digits}f} | {getattr(new, figure):.{digits}f}"
            for figure, digits in (
                ("beyond", 1), ("missing", 1), ("shines_through", 1), ("sharp", 0), ("needles", 0), ("psnr", 1),
            )
        ]  # fmt: skip
        lines.append(f"| {name} | {' | '.join(pairs)} | {new.psnr - old.psnr:+.1f} | {new.seconds:.0f} |")
    return "\n".join(lines)


def summary(before: Mapping[str, Figures], after: Mapping[str, Figures]) -> str:
    """Return sentences that say for how many exhibits detail helps and for how many it harms."""
    gains = {name: after[name].psnr - before[name].psnr for name in before}
    rises, falls = (sum(sign * gain >= NOTICED for gain in gains.values()) for sign in (1, -1))
    best, worst = max(gains, key=lambda name: gains[name]), min(gains, key=lambda name: gains[name])
    clearer, tighter = (
        sum(getattr(after[name], figure) < getattr(before[name], figure) for name in before)
        for figure in ("shines_through", "beyond")
    )
    return (
        f"With {BETTER.detail_steps} steps, the PSNR rises for {rises} and falls for {falls} of {len(gains)} exhibits: "
        f"by {np.mean(list(gains.values())):+.1f} dB on average, between {gains[worst]:+.1f} dB ({worst}) and "
        f"{gains[best]:+.1f} dB ({best}). Less shines through {clearer} of them, and {tighter} reach less beyond their "
        "true mask."
    )


class TrainedScene:
    """A trained scene with objects, and its ground truth."""

    def __init__(self, folder: Path, truth: Path, backend: Backend = "cpu") -> None:
        self.name = folder.resolve().parent.name
        project = ProjectFolder.open_existing(folder)
        self.cameras = read_camera_set(folder / "cameras")
        scene = Scene(load_gaussians(folder / "gaussians"), backend=backend)
        self.views = Views(scene, self.cameras, render_side=BETTER.render_side)
        self.truth = read_ground_truth(truth, [camera.photo for camera in self.cameras.cameras])
        self.photos = DetailPhotos.of(project)
        self.held_out = [camera for camera in self.cameras.cameras if camera.photo in self.photos.held_out]
        self.objects: dict[str, np.ndarray] = {}
        """Members of each exhibit that was found, bool [N]."""
        for record in list_objects(folder):
            members = load_membership(folder, record.id) >= record.threshold
            exhibit = self._exhibit_of(record.prompt.get("text"), members)
            if exhibit is not None:
                self.objects[exhibit] = members

    def detailed(self, name: str, n_steps: int = BETTER.detail_steps) -> tuple[Gaussians, float]:
        """Return the Gaussians of an object with detail, as they are where it was not kept, and seconds.

        They are those of the processor, on a card those that pass.
        """
        members, settings = self.objects[name], replace(BETTER, detail_steps=n_steps)
        clock = time.perf_counter if self.views.scene.backend == "gpu" else time.process_time
        started = clock()
        result = detail_object(self.views, self.photos, members, settings, should_stop=never_stop)
        seconds = clock() - started
        sys.stderr.write(f"{name}: {result.sentence}\n")
        return self.trained(name) if result.detailed is None else result.detailed.gaussians, seconds

    def trained(self, name: str) -> Gaussians:
        """Return the Gaussians of an object as they are in the scene."""
        return replace(self.views.scene.gaussians[self.objects[name]], features=None)

    def measure(self, name: str, alone: Gaussians, seconds: float = 0.0) -> Figures:
        """Return the figures of the Gaussians `alone` of an object."""
        trained = self.trained(name)
        low, high = np.percentile(trained.means, [2, 98], axis=0)
        occluder_distance = _OCCLUDER_DISTANCE * float(np.linalg.norm(high - low)) / 2
        by_view = [self._compare(alone, camera, name, occluder_distance) for camera in self.held_out]
        mean = np.mean([figures for figures in by_view if figures is not None], axis=0).tolist()
        return Figures(*mean, needles=share_of_needles(alone), seconds=seconds)

    def picture(self, name: str, alone: Gaussians) -> np.ndarray:
        """Return the object in the scene, with detail and in the test photo that shows most of it, side by side."""
        camera = max(self.held_out, key=lambda one: self.truth.masks(one.photo).get(name, np.zeros(1)).sum())
        frame, photo, truth = self._photo(camera, name)
        rows, columns = (np.flatnonzero(truth.any(axis=axis)) for axis in (1, 0))
        part = np.s_[max(0, rows[0] - 8) : rows[-1] + 9, max(0, columns[0] - 8) : columns[-1] + 9]
        shown = [rendered(Scene(one), frame)[2] for one in (self.trained(name), alone)]
        return np.hstack([(np.clip(one, 0, 1)[part] * 255).astype(np.uint8) for one in (*shown, photo)])

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
            masks, frame = self.truth.masks(camera.photo), training_pinhole(camera, max_side=BETTER.render_side)
            shown = scene.render(frame, color=True).alpha > 0.5
            for name in set(named) & set(masks):
                true = _in_frame(masks[name], camera, frame)
                overlaps[name].append(float((shown & true).sum() / max((shown | true).sum(), 1)))
        means = {name: float(np.mean(values)) for name, values in overlaps.items() if values}
        best = max(means, key=lambda name: means[name], default=None)
        return best if best is not None and means[best] > 0 else None

    def _photo(self, camera: Camera, exhibit: str) -> tuple[PinholeCamera, np.ndarray, np.ndarray]:
        """Return the frame of a photo at its own size, its pixels in [0, 1], and the true mask of an exhibit in it."""
        frame, pixels = photo_at_own_size(camera, self.photos)
        return frame, pixels, _in_frame(self.truth.masks(camera.photo)[exhibit], camera, frame)

    def _compare(
        self, alone: Gaussians, camera: Camera, exhibit: str, occluder_distance: float
    ) -> tuple[float, ...] | None:
        """Return the figures in one view, the first five of `Figures`; None if the exhibit is hardly visible there."""
        if exhibit not in self.truth.masks(camera.photo):
            return None
        frame, photo, truth = self._photo(camera, exhibit)
        if truth.sum() < _MIN_PIXELS:
            return None
        alpha, depth, color = rendered(Scene(alone), frame)
        hidden = rendered(self.views.scene, frame)[1] < depth - occluder_distance
        inner = erode_mask(truth, EDGE_WIDTH)
        gain = self.photos.gain(camera.photo)
        color = np.clip(color * gain, 0, 1)
        error = float(((color[inner] - photo[inner]) ** 2).mean())
        return (
            100 * float(alpha[~truth & ~hidden].sum() / truth.sum()),
            100 * float((truth & (alpha <= 0.5)).sum() / truth.sum()),
            100 * float((1 - alpha[inner]).mean()),
            -10 * float(np.log10(error)),
            100 * gradient_energy(color, inner) / gradient_energy(photo, inner),
        )


def _in_frame(mask: np.ndarray, camera: Camera, frame: PinholeCamera) -> np.ndarray:
    return np.asarray(undistort(mask.astype(np.uint8), camera, frame, interpolation="nearest")) > 0


def photo_at_own_size(camera: Camera, photos: DetailPhotos) -> tuple[PinholeCamera, np.ndarray]:
    """Return the frame of a photo without distortion at its own size, and its pixels, [H, W, 3] in [0, 1]."""
    frame = training_pinhole(camera, max_side=_MAX_SIDE)
    pixels = undistort(load_pixels(photos.folder / camera.photo), camera, frame, interpolation="linear")
    return frame, np.asarray(pixels, np.float32) / 255


def gradient_energy(picture: np.ndarray, where: np.ndarray) -> float:
    """Return the mean squared gradient of the grey values of a picture, [H, W, 3] in [0, 1], in the pixels `where`."""
    gray = cv2.cvtColor(picture.astype(np.float32), cv2.COLOR_RGB2GRAY)
    return float(sum(np.square(gradient)[where].mean() for gradient in np.gradient(gray)))


def share_of_needles(gaussians: Gaussians) -> float:
    """Return the share of Gaussians longer than five times their middle axis, in percent."""
    ordered = np.sort(gaussians.log_scales, axis=1)
    return 100 * float((ordered[:, 2] - ordered[:, 1] > np.log(_NEEDLE)).mean())


def rendered(scene: Scene, frame: PinholeCamera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return alpha, mean depth and colour on black of a scene."""
    rendered = scene.render(frame, color=True, channels=scene.depth_of(frame)[:, None])
    depth = rendered.channels[..., 3] / np.maximum(rendered.alpha, 1e-3)
    return rendered.alpha, depth, rendered.channels[..., :3]


def main() -> None:
    """Measure and print the table, and write it to the file given by ``--out``."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("projects", type=Path, nargs="+", help="trained projects with objects that were found by text")
    parser.add_argument("--title", help="of the section (default: the name of the room)")
    parser.add_argument("--only", metavar="NAME,NAME", help="measure these exhibits (default: all that were found)")
    parser.add_argument("--picture", type=Path, help="JPEG of the first exhibit: in the scene, with detail, its photo")
    parser.add_argument("--device", choices=("cpu", "gpu"), default="cpu", help="(default: %(default)s)")
    parser.add_argument("--out", type=Path, help="Markdown file for the table")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    read = [TrainedScene(project, _truth_of(project), arguments.device) for project in arguments.projects]
    scenes = [scene for scene in read if scene.objects]
    if not scenes:
        project, prompts = arguments.projects[0], ";".join(dict.fromkeys(read[0].truth.prompts.values()))
        raise SystemExit(
            f"{project} has no exhibit that was found by its text. "
            f'Isolate them first: python -m engine segment {project} --prompt "{prompts}"'
        )
    scenes[0].detailed(next(iter(scenes[0].objects)), 2)  # The first call compiles kernels.
    before, after = {}, {}
    for scene in scenes:
        for name in scene.objects:
            if arguments.only is not None and name not in arguments.only.split(","):
                continue
            key = f"{scene.name}: {name}" if len(scenes) > 1 else name
            alone, seconds = scene.detailed(name)
            before[key], after[key] = scene.measure(name, scene.trained(name)), scene.measure(name, alone, seconds)
            sys.stderr.write(f"{before[key]}\n{after[key]}\n")
            if arguments.picture is not None and len(before) == 1:
                Image.fromarray(scene.picture(name, alone)).save(arguments.picture, quality=90)
    options = "" if arguments.title is None else f" --title '{arguments.title}'"
    options += "" if arguments.device == "cpu" else f" --device {arguments.device}"
    without = [scene.name for scene in read if not scene.objects]
    body = "\n\n".join([
        f"`python -m benchmarks.detail {' '.join(map(str, arguments.projects))}{options}`",
        MARKS["in sample"],
        summary(before, after),
        table_of_exhibits(before, after, "CPU s" if arguments.device == "cpu" else "seconds"),
        *([f"No exhibit was found by its text in {', '.join(without)}."] if without else ()),
    ])  # fmt: skip
    sys.stdout.write(f"{body}\n")
    if arguments.out:
        title = arguments.title or ", ".join(scene.name for scene in scenes)
        write_section(arguments.out, title=title, body=body)


def _truth_of(project: Path) -> Path:
    """Return the folder with the ground truth of a project."""
    folder = project.resolve().parent
    beside, of_demo = folder / "truth", _DEMO / folder.name / "truth"
    if not beside.is_dir() and not of_demo.is_dir():
        raise SystemExit(f"{project} has no ground truth: neither {beside} nor {of_demo} is there.")
    return beside if beside.is_dir() else of_demo


if __name__ == "__main__":
    main()
