"""Cost of joint features, contribution of each part of their training, and convergence of the paper's features.

One of our scenes is trained several times with the Gaussians and image size of the standard preset: with and without
features, for the same seed and number of steps; with one part of the feature training at a time replaced by the paper's
or left out; and with the paper's feature losses, initialisation and learning rates, for increasing numbers of steps.
Cameras and masks are computed once. Trained projects are kept below OUT, in a folder of the scene, and a later run
reuses them.

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
from engine.core.events import ignore_events, never_stop
from engine.core.files import write_file
from engine.pipeline.planning import PlanSettings, WorkPlan, plan_work
from engine.pipeline.reconstruct import PipelineSettings
from engine.project.folder import ProjectFolder
from engine.quality.bench.prepared import prepare, prepare_masks, train_prepared
from engine.quality.evaluation import INTRODUCTION, MEANINGS, evaluate_project, mean_of, write_section
from engine.quality.evaluation.settings import MARKS, EvaluationSettings
from engine.training.settings import PRESETS, TrainingSettings

_MARK = MARKS["in sample"]
_STANDARD = PRESETS["standard"]
_PAPER_FIELDS = (
    "feature_init", "feature_gradient", "clustering_interval", "clustering_pixels", "regularisation",
    "regularisation_interval", "lambda_ray",
)  # fmt: skip
_PARTS = {
    "L_CC on all labelled pixels": {"clustering_pixels": 0},
    "L_CC in one step of 50": {"clustering_interval": 50},
    "the paper's neighbours in L_reg": {"regularisation": "paper"},
    "no variance along the ray": {"lambda_ray": 0.0},
    "features blended without normalisation": {"feature_init": "paper", "lambda_ray": 0.0},
}
_PAPER_FEATURES = _STANDARD.changed(
    **{name: getattr(PRESETS["paper"].features, name) for name in _PAPER_FIELDS},
    lr_features=PRESETS["paper"].optimiser.lr_features,
)


@dataclass(frozen=True)
class TrainingResult:
    """Quality of the objects after a training; means over all objects, prompted by their true masks.

    Attributes
    ----------
    features : str
        Which features were trained, for the table.
    steps : int
    evaluations : int
        Number of evaluations of L_CC.
    paper, better : (float, float)
        IoU and boundary IoU in percent with this preset.
    psnr : float
        On test photos, dB.
    cpu_seconds : float
        Of the training.
    """

    features: str
    steps: int
    evaluations: int
    paper: tuple[float, float]
    better: tuple[float, float]
    psnr: float
    cpu_seconds: float


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

    def train_and_evaluate(self, features: str, name: str, training: TrainingSettings) -> TrainingResult:
        """Train, and isolate every object by its true mask."""
        project = self.trained(name, training)
        rows = evaluate_project(project, self.scene / "truth", EvaluationSettings()).rows
        scores = {
            method: tuple(
                100 * mean_of([getattr(row, measure) for row in rows if row.method == method])
                for measure in ("iou", "boundary_iou")
            )
            for method in ("paper", "better")
        }
        figures = (project.stage_record("training") or {})["figures"]
        paper, better = scores["paper"], scores["better"]
        evaluations = training.schedule.steps // training.features.clustering_interval
        return TrainingResult(
            features, training.schedule.steps, evaluations, (paper[0], paper[1]), (better[0], better[1]),
            figures["psnr"], figures["cpu_seconds"],
        )  # fmt: skip


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


def parts(bench: Bench) -> str:
    """Return the table of our features with one part of their training replaced at a time."""
    rows = [bench.train_and_evaluate("ours", f"joint-{_STANDARD.seed}", _STANDARD)]
    rows += [
        bench.train_and_evaluate(name, "joint-" + "-".join(name.lower().split()), _STANDARD.changed(**changed))
        for name, changed in _PARTS.items()
    ]
    return _table(rows)


def convergence(bench: Bench, steps: Sequence[int]) -> tuple[str, bytes]:
    """Return the table and the plot (PNG) of the paper's features for increasing numbers of steps, with ours."""
    rows = [bench.train_and_evaluate("ours", f"joint-{_STANDARD.seed}", _STANDARD)]
    rows += [
        bench.train_and_evaluate("the paper's", f"paper-{count}", _PAPER_FEATURES.changed(steps=count))
        for count in sorted(steps)
    ]
    return _table(rows), plot_iou(rows)


def _table(rows: Sequence[TrainingResult]) -> str:
    lines = [
        "| features | steps | evaluations of L_CC | `paper` IoU | BIoU | `better` IoU | BIoU | PSNR dB | CPU s |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for row in rows:
        cells = " | ".join(f"{value:.1f}" for value in (*row.paper, *row.better))
        lines.append(
            f"| {row.features} | {row.steps:,} | {row.evaluations:,} | {cells} | {row.psnr:.2f} "
            f"| {row.cpu_seconds:.0f} |"
        )
    return "\n".join(lines)


def plot_iou(rows: Sequence[TrainingResult]) -> bytes:
    """Plot mean IoU against evaluations of L_CC: a line per method on the paper's features, and stars for ours."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 3.8), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    for method, colour in (("paper", "#8a4b2a"), ("better", "#3f6673")):
        for features, style in (("the paper's", "o-"), ("ours", "*")):
            selected = sorted((row for row in rows if row.features == features), key=lambda row: row.evaluations)
            values = [getattr(row, method)[0] for row in selected]
            axes.plot(
                [row.evaluations for row in selected],
                values,
                style,
                color=colour,
                label=f"`{method}`, features: {features}",
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
    """Train, compare and print the tables, and write them to the file given by ``--doc``."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, help="folder of one of our scenes, with photos/ and truth/")
    parser.add_argument("--out", type=Path, required=True, help="folder for the trained projects")
    parser.add_argument(
        "--seeds", default="0", metavar="N,N", help="seeds to train with and without features (default: 0); '' for none"
    )
    parser.add_argument(
        "--paper-steps", default="", metavar="N,N", help="numbers of steps to train the paper's features for"
    )
    parser.add_argument("--parts", action="store_true", help="replace one part of our feature training at a time")
    parser.add_argument("--doc", type=Path, metavar="FILE.md", help="file for the sections")
    arguments = parser.parse_args()
    bench = Bench(arguments.scene, arguments.out)
    name, seeds, steps = arguments.scene.name, _numbers(arguments.seeds), _numbers(arguments.paper_steps)
    command = f"python -m benchmarks.joint_features demo/{name} --out out/joint"
    if seeds:
        table = cost(bench, seeds)
        _write(
            arguments.doc,
            f"{name}: cost of joint features",
            f"```\n{command} --seeds {arguments.seeds}\n```\n\n{_MARK}\n\n{table}",
        )
    if arguments.parts:
        _write(
            arguments.doc,
            f"{name}: contribution of each part of the feature training",
            f"```\n{command} --seeds '' --parts\n```\n\n{_MARK}\n\n{parts(bench)}\n\n"
            "Every row is a new training with the same seed. All objects are prompted by their true masks and "
            "evaluated on test photos.",
        )
    if steps:
        table, image = convergence(bench, steps)
        options = f"--paper-steps {arguments.paper_steps}"
        text = f"```\n{command} --seeds '' {options}\n```\n\n{_MARK}\n\n{table}\n\n"
        text += (
            "The paper's feature losses, initialisation, learning rates and intervals, with the Gaussians and image "
            "size of the standard preset. Every row is a new training with a schedule of its length. All objects are "
            "prompted by their true masks and evaluated on test photos. The published training has "
            f"{PRESETS['paper'].schedule.steps:,} steps, so shorter rows do not tell what the paper's features reach "
            "in the end."
        )
        if arguments.doc:
            file = arguments.doc.with_name(f"{arguments.doc.stem}_{name}_steps.png")
            write_file(file, image)
            text += f"\n\n![IoU against evaluations of L_CC]({file.name})"
        _write(arguments.doc, f"{name}: the paper's features with longer training", text)


def _numbers(text: str) -> list[int]:
    """Return the integers of a comma-separated list."""
    return [int(number) for number in text.split(",") if number.strip()]


def _write(doc: Path | None, title: str, body: str) -> None:
    """Print a section, and write it to `doc` if given."""
    sys.stdout.write(f"{title}\n\n{body}\n\n")
    sys.stdout.flush()
    if doc:
        write_section(doc, introduction=INTRODUCTION, title=title, body=body, closing=MEANINGS)


if __name__ == "__main__":
    main()
