"""Checkpoints of training runs, written atomically. A killed or cancelled run resumes from its checkpoint exactly.

Random draws depend on the step only (`schedule.Schedule.generator`), so the parameters, their moments, the step and the
cached neighbours are the complete state.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import zipfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ..errors import NumericalError
from ..files import atomic_write
from ..rasterizer import AdamState
from ..scene import Gaussians
from ..settings import to_dict
from .guards import ADVICE
from .held_out import CurvePoint
from .parameters import NAMES, Parameters
from .settings import TrainingSettings
from .trials import Trial
from .views import TrainingView

__all__ = [
    "CHECKPOINT_FILE",
    "RunState",
    "delete_old_runs",
    "latest_run",
    "read_checkpoint",
    "read_progress",
    "read_state",
    "run_key",
    "write_checkpoint",
]

CHECKPOINT_FILE = "training.npz"
VERSION = 3
"""Version of the format, part of the key of a run."""

N_OTHER_RUNS_KEPT = 2
"""Number of other runs whose checkpoints are kept. Three checkpoints of the largest preset take half a gigabyte."""

TRANSIENT_MASK_PREFIX = "out_of_place."
"""Beginning of the names of the arrays with transient masks."""

SETTINGS_WITHOUT_EFFECT = ("checkpoint_interval", "preview_seconds")
"""Stored names of the settings that do not change the result."""


@dataclass
class RunState:
    """Everything that changes during a training run.

    Attributes
    ----------
    parameters : Parameters
    exposure : tensor of shape [n_train, 3], float32
        Logarithm of the brightness factor of each training photo.
    exposure_moments : AdamState
    step : int
        Number of finished steps.
    cooling_from : int or None
        Step at which the cooldown began because the curve was flat; None when it was not.
    sh_limit : int or None
        Highest band of view-dependent colour that passed its trial so far; None in a run without trials.
    uses_exposure : bool
        Whether the brightness factors are in use.
    trials : list of Trial
        Finished trials.
    transient_masks : dict of int to bool array of shape [h, w]
        Pixels that are left out of training photos because they show transients, by number of the photo.
    neighbours : int tensor of shape [N, k] or None
        Nearest neighbours for L_reg, cached.
    neighbours_step : int
        Step at which they were found.
    curve : list of CurvePoint
    guards : Counter
        How often each numerical guard took effect.
    wall_seconds, cpu_seconds : float
        Time spent so far.
    """

    parameters: Parameters
    exposure: torch.Tensor
    exposure_moments: AdamState
    step: int = 0
    cooling_from: int | None = None
    sh_limit: int | None = None
    uses_exposure: bool = False
    trials: list[Trial] = field(default_factory=list)
    transient_masks: dict[int, NDArray[np.bool_]] = field(default_factory=dict)
    neighbours: torch.Tensor | None = None
    neighbours_step: int = 0
    curve: list[CurvePoint] = field(default_factory=list)
    guards: Counter[str] = field(default_factory=Counter)
    wall_seconds: float = 0.0
    cpu_seconds: float = 0.0

    def copy(self) -> RunState:
        """Return an independent copy that can be trained further."""
        return replace(
            self,
            parameters=self.parameters.copy(),
            exposure=self.exposure.detach().clone(),
            exposure_moments=self.exposure_moments.copy(),
            trials=list(self.trials),
            transient_masks=dict(self.transient_masks),
            curve=list(self.curve),
            guards=Counter(self.guards),
        )


def run_key(start: Gaussians, views: Sequence[TrainingView], settings: TrainingSettings) -> str:
    """Return a hash of everything that the result depends on; a checkpoint with another key is not resumed."""
    values = {name: v for name, v in to_dict(settings).items() if name not in SETTINGS_WITHOUT_EFFECT}
    digest = hashlib.sha256(json.dumps([VERSION, values], sort_keys=True).encode())
    for array in (start.means, start.log_scales, start.quats, start.opacity_logits, start.sh, start.features):
        if array is not None:
            digest.update(np.ascontiguousarray(array).tobytes())
    for view in views:
        digest.update(f"{view.photo}|{view.held_out}|".encode())
        parts: tuple[NDArray[Any] | None, ...] = (view.pixels, view.labels, view.pinhole.K, view.pinhole.viewmat)
        if view.valid is not None:
            parts += (view.valid,)
        for part in parts:
            digest.update(b"-" if part is None else np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()


def write_checkpoint(folder: Path, key: str, state: RunState) -> None:
    """Write `state` into `folder`, replacing the earlier checkpoint.

    Raises
    ------
    DiskError, NumericalError
        When it cannot be written or contains a value that is not finite. The earlier checkpoint then stays complete.
    """
    arrays = {f"value.{name}": value.detach().numpy() for name, value in state.parameters.values.items()}
    moments = {**state.parameters.moments, "exposure": state.exposure_moments}
    for name, moment in moments.items():
        arrays[f"first.{name}"] = moment.mean.numpy()
        arrays[f"second.{name}"] = moment.square.numpy()
    arrays["exposure"] = state.exposure.detach().numpy()
    arrays |= {f"{TRANSIENT_MASK_PREFIX}{view}": mask for view, mask in state.transient_masks.items()}
    if state.neighbours is not None:
        arrays["neighbours"] = state.neighbours.numpy()
    _check_finite(arrays, state.step)
    record = {
        "version": VERSION,
        "key": key,
        "step": state.step,
        "cooling_from": state.cooling_from,
        "sh_limit": state.sh_limit,
        "uses_exposure": state.uses_exposure,
        "trials": [asdict(trial) for trial in state.trials],
        "adam_steps": {name: moment.step for name, moment in moments.items()},
        "neighbours_step": state.neighbours_step,
        "curve": [asdict(point) for point in state.curve],
        "guards": dict(state.guards),
        "wall_seconds": state.wall_seconds,
        "cpu_seconds": state.cpu_seconds,
    }
    arrays["record"] = np.array(json.dumps(record))
    with atomic_write(folder / CHECKPOINT_FILE) as stream:
        np.savez(stream, **arrays)


def _check_finite(arrays: dict[str, NDArray[Any]], step: int) -> None:
    for name, array in arrays.items():
        if not np.isfinite(array).all():
            raise NumericalError(f"`{name}` is not finite after step {step}. {ADVICE}")


def read_checkpoint(folder: Path, key: str) -> RunState | None:
    """Return the state stored in `folder`; None when it is missing, damaged, or belongs to another run."""
    return read_state(folder, key)


def read_state(folder: Path, key: str | None = None) -> RunState | None:
    """Return the state stored in `folder`, of any run without a `key`; None as for `read_checkpoint`."""
    path = folder / CHECKPOINT_FILE
    if not path.is_file():
        return None
    try:
        # Opened here because NumPy does not close a file that it finds damaged.
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            record = json.loads(str(stored["record"]))
            if key is not None and record["key"] != key:
                return None
            return _state_from(dict(stored), record)
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile):
        return None


def read_progress(folder: Path) -> dict[str, Any] | None:
    """Return the progress of the run in `folder`, without its arrays; None when there is no complete checkpoint.

    Returns
    -------
    dict
        ``step``, ``curve`` (list of dict), ``wall_seconds`` and ``cpu_seconds``, as JSON values.
    """
    try:
        with (folder / CHECKPOINT_FILE).open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            record = json.loads(str(stored["record"]))
            return {name: record[name] for name in ("step", "curve", "wall_seconds", "cpu_seconds")}
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile):
        return None


def delete_old_runs(folder: Path, *, keep: str) -> None:
    """Delete the checkpoints in `folder`, one folder per run, except those of `keep` and of the two latest other runs.

    A user who tries another preset and returns to the first one resumes its run.
    """
    others = [path for path in folder.glob("*") if path.name != keep]
    for old in sorted(others, key=_written_at, reverse=True)[N_OTHER_RUNS_KEPT:]:
        shutil.rmtree(old)


def latest_run(folder: Path) -> Path | None:
    """Return the folder of the run in `folder` with the latest checkpoint, None when there is no checkpoint."""
    return max((path for path in folder.glob("*") if (path / CHECKPOINT_FILE).is_file()), key=_written_at, default=None)


def _written_at(run: Path) -> float:
    """Return the time when the checkpoint of a run was written, 0 without a checkpoint."""
    file = run / CHECKPOINT_FILE
    return file.stat().st_mtime if file.is_file() else 0.0


def _state_from(arrays: dict[str, NDArray[Any]], record: dict[str, Any]) -> RunState:
    steps = record["adam_steps"]

    def moments(name: str) -> AdamState:
        return AdamState(
            torch.from_numpy(arrays[f"first.{name}"]), torch.from_numpy(arrays[f"second.{name}"]), int(steps[name])
        )

    names = [name for name in NAMES if f"value.{name}" in arrays]
    neighbours = arrays.get("neighbours")
    return RunState(
        parameters=Parameters(
            {name: torch.from_numpy(arrays[f"value.{name}"]) for name in names}, {n: moments(n) for n in names}
        ),
        exposure=torch.from_numpy(arrays["exposure"]),
        exposure_moments=moments("exposure"),
        step=int(record["step"]),
        cooling_from=record["cooling_from"],
        sh_limit=record["sh_limit"],
        uses_exposure=record["uses_exposure"],
        trials=[Trial(**trial) for trial in record["trials"]],
        transient_masks={
            int(name.removeprefix(TRANSIENT_MASK_PREFIX)): mask
            for name, mask in arrays.items()
            if name.startswith(TRANSIENT_MASK_PREFIX)
        },
        neighbours=None if neighbours is None else torch.from_numpy(neighbours),
        neighbours_step=int(record["neighbours_step"]),
        curve=[CurvePoint(**point) for point in record["curve"]],
        guards=Counter(record["guards"]),
        wall_seconds=float(record["wall_seconds"]),
        cpu_seconds=float(record["cpu_seconds"]),
    )
