"""What joint features cost, what each part of their training is worth, and whether the paper's own are trained to the
end.

Trains one of our scenes with the standard budget and picture size several times: without features and with them, by
the same seed for the same number of steps; with one part of their training at a time as the paper has it or left out;
and with the paper's feature losses, start and rates for more and more steps, or evaluated more and more often. Cameras
and masks are made once, in OUT/scene; what is trained is kept, and a further run goes on.

example: python -m benchmarks.joint_features demo/museum_room --out out/joint --paper-steps 750,1500,3000,6000
"""

from __future__ import annotations

import argparse
import io
import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from engine.cameras.settings import CameraSettings
from engine.evaluation import INTRODUCTION, MEANINGS, evaluate_project, mean_of, write_section
from engine.evaluation.settings import EvaluationSettings
from engine.events import ignore_events, never_stop
from engine.grounding import load_default_detector
from engine.masks import load_default_sam
from engine.pipeline import PipelineSettings, Prepared, prepare, prepare_masks, train_prepared
from engine.planning import PlanSettings, WorkPlan, plan_work
from engine.project_folder import ProjectFolder, atomic_write
from engine.training.settings import PRESETS, TrainingSettings

_STANDARD = replace(PRESETS["standard"], stop_when_flat=0.0)
_OF_THE_PAPER = (
    "feature_init", "feature_gradient", "lr_features", "clustering_interval", "clustering_pixels", "regularisation",
    "regularisation_interval", "lambda_ray",
)  # fmt: skip
_PARTS = {
    "L_CC on all labelled pixels": {"clustering_pixels": 0},
    "L_CC in one step of 50": {"clustering_interval": 50},
    "the paper's neighbours in L_reg": {"regularisation": "paper"},
    "no variance along the ray": {"lambda_ray": 0.0},
    "features blended as they are": {"feature_init": "paper", "lambda_ray": 0.0},
}
_PAPER_FEATURES = replace(_STANDARD, **{name: getattr(PRESETS["paper"], name) for name in _OF_THE_PAPER})


@dataclass(frozen=True)
class Converged:
    """How well objects come out, in percent, after a number of steps; means over the objects by their true masks."""

    features: str
    steps: int
    evaluations: int
    paper: tuple[float, float]
    better: tuple[float, float]
    psnr: float
    cpu_seconds: float


class Bench:
    """A scene of ours whose cameras and masks are made."""

    def __init__(self, scene: Path, out: Path) -> None:
        self.scene, self.out = scene, out
        settings = PipelineSettings()
        self.prepared = prepare(scene / "photos", out / "scene", settings, emit=ignore_events, should_stop=never_stop)
        self.prepared, _ = prepare_masks(
            self.prepared, out / "scene", self._plan(True), settings, emit=ignore_events, should_stop=never_stop
        )

    def _plan(self, features: bool) -> WorkPlan:
        wishes = PlanSettings(preset="standard", wants_objects=features)
        given = self.prepared.camera_set.poses_given
        return plan_work(
            self.prepared.photo_set, self.prepared.looks, wishes, cameras=CameraSettings(), poses_given=given,
            points_given=given,
        )  # fmt: skip

    def trained(self, name: str, training: TrainingSettings) -> ProjectFolder:
        """Return a project of its own, trained so; what was trained before is taken as it is."""
        sys.stderr.write(f"{name}...\n")
        folder, given = self.out / name, self.prepared
        prepared = (
            given if training.features else Prepared(given.photo_set, given.looks, given.camera_set, {}, given.earlier)
        )
        project = train_prepared(
            prepared, folder, self._plan(training.features), training, emit=ignore_events, should_stop=never_stop
        )
        for part in ("cameras", "masks"):
            shutil.copytree(self.out / "scene" / part, folder / part, dirs_exist_ok=True)
        with project:
            project.put("photo_folder", str((self.scene / "photos").resolve()))
        return project

    def converged(self, features: str, name: str, training: TrainingSettings) -> Converged:
        """Train, and isolate every object by its true mask."""
        project = self.trained(name, training)
        rows = evaluate_project(
            project, self.scene / "truth", EvaluationSettings(), detector_factory=load_default_detector,
            sam_factory=load_default_sam, emit=ignore_events, should_stop=never_stop,
        ).rows  # fmt: skip
        scores = {
            way: tuple(
                100 * mean_of([getattr(row, measure) for row in rows if row.way == way])
                for measure in ("iou", "boundary_iou")
            )
            for way in ("paper", "better")
        }
        figures = (project.stage_record("training") or {})["figures"]
        paper, better = scores["paper"], scores["better"]
        evaluations = training.steps // training.clustering_interval
        return Converged(
            features, training.steps, evaluations, (paper[0], paper[1]), (better[0], better[1]), figures["psnr"],
            figures["cpu_seconds"],
        )  # fmt: skip


def cost(bench: Bench, seeds: Sequence[int]) -> str:
    """Return the table of what features cost the pictures."""
    lines = [
        "| seed | features | steps | PSNR dB | SSIM | L1 | CPU s |",
        "| ---: | --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    lost = []
    for seed in seeds:
        psnr = {}
        for features in (False, True):
            name = f"{'joint' if features else 'none'}-{seed}"
            training = replace(_STANDARD, features=features, seed=seed)
            figures = (bench.trained(name, training).stage_record("training") or {})["figures"]
            psnr[features] = figures["psnr"]
            lines.append(
                f"| {seed} | {'joint' if features else 'none'} | {figures['steps']:,} | {figures['psnr']:.2f} "
                f"| {figures['ssim']:.4f} | {figures['l1']:.4f} | {figures['cpu_seconds']:.0f} |"
            )
        lost.append(psnr[False] - psnr[True])
    each = ", ".join(f"{value:+.2f}" for value in lost)
    return (
        "\n".join(lines) + f"\n\nPSNR lost through the features: {mean_of(lost):+.2f} dB"
        f"{f' on average ({each})' if len(lost) > 1 else ''}, on held-out photos; same seed, same steps."
    )


def parts(bench: Bench) -> str:
    """Return the table of our features with one part of their training exchanged at a time."""
    rows = [bench.converged("ours", f"joint-{_STANDARD.seed}", _STANDARD)]
    rows += [
        bench.converged(name, "joint-" + "-".join(name.lower().split()), replace(_STANDARD, **changed))
        for name, changed in _PARTS.items()
    ]
    return _table(rows)


def convergence(bench: Bench, steps: Sequence[int], intervals: Sequence[int]) -> tuple[str, bytes]:
    """Return the table of the paper's features after more and more evaluations, ours beside them; and its picture."""
    rows = [bench.converged("ours", f"joint-{_STANDARD.seed}", _STANDARD)]
    trainings = {f"paper-{count}": replace(_PAPER_FEATURES, steps=count) for count in sorted(steps)}
    trainings |= {
        f"paper-every-{interval}": replace(_PAPER_FEATURES, clustering_interval=interval)
        for interval in sorted(intervals, reverse=True)
    }
    rows += [bench.converged("the paper's", name, training) for name, training in trainings.items()]
    return _table(rows), picture(rows)


def _table(rows: Sequence[Converged]) -> str:
    lines = [
        "| features | steps | L_CC evaluated | `paper` IoU | BIoU | `better` IoU | BIoU | PSNR dB | CPU s |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for row in rows:
        cells = " | ".join(f"{value:.1f}" for value in (*row.paper, *row.better))
        lines.append(
            f"| {row.features} | {row.steps:,} | {row.evaluations:,} | {cells} | {row.psnr:.2f} "
            f"| {row.cpu_seconds:.0f} |"
        )
    return "\n".join(lines)


def picture(rows: Sequence[Converged]) -> bytes:
    """Draw mean IoU against evaluations of L_CC: a line a way of isolating, on the paper's features; ours as stars."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 3.8), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    for way, colour in (("paper", "#8a4b2a"), ("better", "#3f6673")):
        for features, style in (("the paper's", "o-"), ("ours", "*")):
            own = sorted((row for row in rows if row.features == features), key=lambda row: row.evaluations)
            values = [getattr(row, way)[0] for row in own]
            axes.plot(
                [row.evaluations for row in own], values, style, color=colour, label=f"`{way}`, features: {features}"
            )
    axes.set_xscale("log")
    axes.set_xlabel("evaluations of L_CC", fontsize=8)
    axes.set_title("IoU, %", fontsize=9, loc="left")
    axes.grid(alpha=0.25, linewidth=0.6)
    axes.legend(fontsize=7, frameon=False)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110, metadata={"Software": None})
    return buffer.getvalue()


def main() -> None:
    """Train, compare and, if wanted, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, help="folder with photos/ and truth/, one of ours")
    parser.add_argument("--out", type=Path, required=True, help="folder for what is trained")
    parser.add_argument(
        "--seeds", default="0", metavar="N,N", help="to train by, with and without (default: 0); '' for none"
    )
    parser.add_argument("--paper-steps", default="", metavar="N,N", help="to train the paper's features for")
    parser.add_argument("--paper-intervals", default="", metavar="N,N", help="steps between evaluations of its L_CC")
    parser.add_argument("--parts", action="store_true", help="exchange one part of our training at a time")
    parser.add_argument("--doc", type=Path, metavar="FILE.md", help="also write sections there")
    arguments = parser.parse_args()
    bench = Bench(arguments.scene, arguments.out)
    name, seeds, steps = arguments.scene.name, _numbers(arguments.seeds), _numbers(arguments.paper_steps)
    intervals = _numbers(arguments.paper_intervals)
    command = f"python -m benchmarks.joint_features demo/{name} --out out/joint"
    if seeds:
        table = cost(bench, seeds)
        _tell(
            arguments.doc,
            f"{name}: what joint features cost",
            f"```\n{command} --seeds {arguments.seeds}\n```\n\n{table}",
        )
    if arguments.parts:
        _tell(
            arguments.doc,
            f"{name}: what each part of training the features is worth",
            f"```\n{command} --seeds '' --parts\n```\n\n{parts(bench)}\n\n"
            "Every row trained anew by the same seed. All objects by their true masks, held-out photos.",
        )
    if steps or intervals:
        table, image = convergence(bench, steps, intervals)
        asked = f"--paper-steps {arguments.paper_steps} --paper-intervals {arguments.paper_intervals}"
        text = f"```\n{command} --seeds '' {asked}\n```\n\n{table}\n\n"
        text += (
            "The paper's feature losses, start, rates and intervals on the standard preset's Gaussians and pictures, "
            "every row trained anew with a schedule of its length. All objects by their true masks, held-out photos. "
            "The published 30,000 steps evaluate L_CC 600 times, one step in 50: as often as 3,000 steps with one in 5."
        )
        if arguments.doc:
            file = arguments.doc.with_name(f"{arguments.doc.stem}_{name}_steps.png")
            with atomic_write(file) as stream:
                stream.write(image)
            text += f"\n\n![IoU against evaluations of L_CC]({file.name})"
        _tell(arguments.doc, f"{name}: the paper's features, trained for longer", text)


def _numbers(text: str) -> list[int]:
    return [int(number) for number in text.split(",") if number.strip()]


def _tell(doc: Path | None, title: str, body: str) -> None:
    sys.stdout.write(f"{title}\n\n{body}\n\n")
    sys.stdout.flush()
    if doc:
        write_section(doc, introduction=INTRODUCTION, title=title, body=body, closing=MEANINGS)


if __name__ == "__main__":
    main()
