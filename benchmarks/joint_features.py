"""Cost of joint features: one of our scenes trained with and without them, by the standard preset.

Each pair of trainings has the same seed and number of steps. Cameras and masks are computed once. Trained projects are
kept below OUT, in a folder of the scene, and a later run reuses them.

example: python -m benchmarks.joint_features demo/museum_room --out out/joint --seeds 0,1,2 --doc docs/segmentation.md
"""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from engine.cameras.settings import CameraSettings
from engine.core.events import ignore_events, never_stop
from engine.pipeline.planning import PlanSettings, WorkPlan, plan_work
from engine.pipeline.reconstruct import PipelineSettings
from engine.project.folder import ProjectFolder
from engine.quality.bench.prepared import prepare, prepare_masks, train_prepared
from engine.quality.evaluation import INTRODUCTION, MEANINGS, mean_of, write_section
from engine.quality.evaluation.settings import MARKS
from engine.training.settings import PRESETS, TrainingSettings

_MARK = MARKS["in sample"]
_STANDARD = PRESETS["standard"]


class Bench:
    """One of our scenes, with computed cameras and masks."""

    def __init__(self, scene: Path, out: Path) -> None:
        self.scene, self.out = scene, out / scene.name
        settings = PipelineSettings()
        self.prepared = prepare(
            scene / "photos", self.out / "scene", settings, emit=ignore_events, should_stop=never_stop
        )
        self.prepared, _ = prepare_masks(
            self.prepared, self.out / "scene", self._plan(True), settings, emit=ignore_events, should_stop=never_stop
        )

    def _plan(self, features: bool) -> WorkPlan:
        settings = PlanSettings(preset="standard", wants_objects=features)
        poses_given = self.prepared.camera_set.poses_given
        return plan_work(
            self.prepared.photo_set, self.prepared.statistics, settings, cameras=CameraSettings(),
            poses_given=poses_given, points_given=poses_given,
        )  # fmt: skip

    def trained(self, name: str, training: TrainingSettings) -> ProjectFolder:
        """Return the project `name` after training with these settings; a training of an earlier run is reused."""
        sys.stderr.write(f"{name}...\n")
        folder, prepared = self.out / name, self.prepared
        prepared = prepared if training.features.train_features else replace(prepared, label_maps={})
        project = train_prepared(
            prepared,
            folder,
            self._plan(training.features.train_features),
            training,
            emit=ignore_events,
            should_stop=never_stop,
        )
        for part in ("cameras", "masks"):
            shutil.copytree(self.out / "scene" / part, folder / part, dirs_exist_ok=True)
        with project:
            project.put("photo_folder", str((self.scene / "photos").resolve()))
        return project


def cost(bench: Bench, seeds: Sequence[int]) -> str:
    """Return the table of trainings with and without features, and the loss of PSNR."""
    lines = [
        "| seed | features | steps | PSNR dB | SSIM | L1 | CPU s |",
        "| ---: | --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    losses = []
    for seed in seeds:
        psnr = {}
        for features in (False, True):
            name = f"{'joint' if features else 'none'}-{seed}"
            training = _STANDARD.changed(train_features=features, seed=seed)
            figures = (bench.trained(name, training).stage_record("training") or {})["figures"]
            psnr[features] = figures["psnr"]
            lines.append(
                f"| {seed} | {'joint' if features else 'none'} | {figures['steps']:,} | {figures['psnr']:.2f} "
                f"| {figures['ssim']:.4f} | {figures['l1']:.4f} | {figures['cpu_seconds']:.0f} |"
            )
        losses.append(psnr[False] - psnr[True])
    values = ", ".join(f"{loss:+.2f}" for loss in losses)
    return (
        "\n".join(lines) + "\n\nLoss of PSNR on test photos with features, for the same seed and steps: "
        f"{mean_of(losses):+.2f} dB{f' on average ({values})' if len(losses) > 1 else ''}."
    )


def main() -> None:
    """Train, compare and print the table, and write it to the file given by ``--doc``."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, help="folder of one of our scenes, with photos/")
    parser.add_argument("--out", type=Path, required=True, help="folder for the trained projects")
    parser.add_argument("--seeds", default="0", metavar="N,N", help="seeds to train with (default: %(default)s)")
    parser.add_argument("--doc", type=Path, metavar="FILE.md", help="file for the section")
    options = parser.parse_args()
    name = options.scene.name
    table = cost(Bench(options.scene, options.out), [int(number) for number in options.seeds.split(",")])
    command = f"python -m benchmarks.joint_features demo/{name} --out out/joint --seeds {options.seeds}"
    title, body = f"{name}: cost of joint features", f"```\n{command}\n```\n\n{_MARK}\n\n{table}"
    sys.stdout.write(f"{title}\n\n{body}\n\n")
    if options.doc:
        write_section(options.doc, introduction=INTRODUCTION, title=title, body=body, closing=MEANINGS)


if __name__ == "__main__":
    main()
