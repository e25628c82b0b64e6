"""Whether objects lose by label maps in bfloat16: each room with label maps in float32 and in bfloat16, several seeds.

    python -m benchmarks.rooms.label_precision out/rooms/room_1 out/rooms/room_2 --seeds 0,1,2

Each folder has ``photos``, ``cameras`` and ``truth``, as `python -m benchmarks.rooms run` makes them. A scene that is
done in the folder of results is not trained again. The processor should multiply bfloat16; others take longer.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from unittest import mock

import numpy as np

from engine.core import processor
from engine.core.events import ignore_events, never_stop
from engine.masks import load_default_sam
from engine.objects.grounding import load_default_detector
from engine.project.folder import ProjectFolder
from engine.quality.evaluation import evaluate_project
from engine.quality.evaluation.settings import EvaluationSettings

from .reconstruction import reconstruct_room


def main() -> None:
    """Print one row of a Markdown table per room, and the mean change with its standard error over the rooms."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rooms", nargs="+", type=Path)
    parser.add_argument("--seeds", default="0,1,2", help="(default: %(default)s)")
    parser.add_argument("--out", type=Path, default=Path("out/label_precision"), help="(default: %(default)s)")
    options = parser.parse_args()
    seeds = [int(seed) for seed in options.seeds.split(",")]
    print(f"| room | float32, seeds {options.seeds} | bfloat16 | change of the mean |")
    print("| --- | --- | --- | ---: |")
    changes = []
    for room in options.rooms:
        before, after = (
            [_percent(room, options.out / f"{room.name}-{seed}-{bfloat16}", seed, bfloat16) for seed in seeds]
            for bfloat16 in (False, True)
        )
        changes.append(np.mean(after) - np.mean(before))
        columns = (", ".join(f"{one:.1f}" for one in ious) for ious in (before, after))
        print(f"| {room.name} | {' | '.join(columns)} | {changes[-1]:.1f} |", flush=True)
    error = np.std(changes, ddof=1) / len(changes) ** 0.5 if len(changes) > 1 else float("nan")
    print(f"\nMean change: {np.mean(changes):+.2f} ± {error:.2f}")


def _percent(room: Path, out: Path, seed: int, bfloat16: bool) -> float:
    """Return the mean IoU of the objects of a room by mask, in percent, after reconstructing it in the folder `out`."""
    with mock.patch.object(processor, "multiplies_bfloat16", lambda: bfloat16):
        reconstruct_room(room, out, seed=seed, emit=ignore_events, should_stop=never_stop)
    rows = evaluate_project(
        ProjectFolder.open_existing(out), room / "truth", EvaluationSettings(presets=("better",), prompt_kind="mask"),
        detector_factory=load_default_detector, sam_factory=load_default_sam,
        emit=ignore_events, should_stop=never_stop,
    ).rows  # fmt: skip
    return 100 * float(np.mean([row.iou for row in rows]))


if __name__ == "__main__":
    main()
