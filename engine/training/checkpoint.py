"""Checkpoints of training runs, written atomically. A killed or cancelled run resumes from its checkpoint exactly.

Random draws depend on the step only (`schedule.Schedule.generator`), so the parameters, their moments, the step and the
cached neighbours are the complete state.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ..core.errors import FormatError, NumericalError
from ..core.files import ArraySpec, atomic_write, delete_derived, finite_or_null, parse_json, read_arrays
from ..scene import Gaussians
from .adam import AdamState
from .card_settings import key_values
from .guards import ADVICE
from .held_out import CurvePoint
from .parameters import NAMES, Parameters
from .settings import TrainingSettings
from .trials import Trial
from .views import TrainingView

CHECKPOINT_FILE = "training.npz"
VERSION = 4
"""Version of the format, part of the key of a run."""

N_OTHER_RUNS_KEPT = 2
"""Number of other runs whose checkpoints are kept. Three checkpoints of the largest preset take half a gigabyte."""

TRANSIENT_MASK_PREFIX = "out_of_place."
"""Beginning of the names of the arrays with transient masks."""

SETTINGS_WITHOUT_EFFECT = ("checkpoint_interval", "preview_seconds")
"""Stored names of the settings that do not change the result."""

_ADVICE = "Training starts again."
_MAX_MASK_SIDE = 32_766
"""Pixels; OpenCV cannot resize larger pictures."""


def _array_specs() -> tuple[dict[str, ArraySpec], dict[str, ArraySpec]]:
    """Return the arrays that every checkpoint has, and those that it may have."""

    def finite(*shape: int | str) -> ArraySpec:
        return ArraySpec("float32", shape, finite=True)

    values = {
        "value.means": finite("n", 3),
        "value.log_scales": finite("n", 3),
        "value.quats": finite("n", 4),
        "value.opacity_logits": finite("n"),
        "value.sh_dc": finite("n", 1, 3),
        "exposure": finite("n_train", 3),
        "record": ArraySpec("str", ()),
    }
    optional = {
        "value.sh_rest": finite("n", "n_rest", 3),
        "value.features": finite("n", "n_features"),
        # Each pair of moments must have the shape of its values, see `_state_from`.
        "first.*": ArraySpec("float32", finite=True),
        "second.*": ArraySpec("float32", finite=True),
        "neighbours": ArraySpec("int32", ("n_neighbours", "k")),
        f"{TRANSIENT_MASK_PREFIX}*": ArraySpec("bool"),
    }
    return values, optional


_ARRAYS, _OPTIONAL_ARRAYS = _array_specs()
_POINT = {
    "step": int,
    "wall_seconds": float,
    "cpu_seconds": float,
    "psnr": (float, None),
    "ssim": (float, None),
    "l1": (float, None),
    "n_gaussians": int,
}
_TRIAL = {"what": str, "step": int, "n_steps": int, "gain": (float, None), "kept": bool}
_RECORD = {
    "version": int,
    "key": str,
    "step": int,
    "sh_limit": (int, None),
    "trials": [_TRIAL],
    "adam_steps": {str: int},
    "neighbours_step": int,
    "curve": [_POINT],
    "guards": {str: int},
    "wall_seconds": float,
    "cpu_seconds": float,
}
"""The values of a checkpoint that are not arrays. JSON has no NaN: an error that could not be measured is null."""


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
    sh_limit : int or None
        Highest band of view-dependent colour that passed its trial so far; None in a run without trials.
    trials : list of Trial
        Finished trials.
    transient_masks : dict of int to bool array of shape [h, w]
        Pixels that are left out of training photos because they show transients, by number of the photo.
    neighbours : int tensor of shape [N, k] or None
        Nearest neighbours for L_reg, cached.
    neighbours_step : int
        Step at which they were found.
    curve : list of CurvePoint
        Errors on the test photos.
    guards : Counter
        How often each numerical guard took effect.
    wall_seconds, cpu_seconds : float
        Time spent so far.
    """

    parameters: Parameters
    exposure: torch.Tensor
    exposure_moments: AdamState
    step: int = 0
    sh_limit: int | None = None
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
    """Return a hash of what the result depends on, but the device; a checkpoint with another key is not resumed."""
    values = {name: v for name, v in key_values(settings).items() if name not in SETTINGS_WITHOUT_EFFECT}
    digest = hashlib.sha256(json.dumps([VERSION, values], sort_keys=True).encode())
    for array in (start.means, start.log_scales, start.quats, start.opacity_logits, start.sh, start.features):
        if array is not None:
            digest.update(np.ascontiguousarray(array).tobytes())
    for view in views:
        digest.update(f"{view.photo}|{view.held_out}|".encode())
        labels = None if view.labels is None else view.labels.array()
        parts: tuple[NDArray[Any] | None, ...] = (view.pixels, labels, view.pinhole.K, view.pinhole.viewmat)
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
        "sh_limit": state.sh_limit,
        "trials": [asdict(trial) for trial in state.trials],
        "adam_steps": {name: moment.step for name, moment in moments.items()},
        "neighbours_step": state.neighbours_step,
        "curve": [asdict(point) for point in state.curve],
        "guards": dict(state.guards),
        "wall_seconds": state.wall_seconds,
        "cpu_seconds": state.cpu_seconds,
    }
    arrays["record"] = np.array(json.dumps(finite_or_null(record)))
    with atomic_write(folder / CHECKPOINT_FILE) as stream:
        np.savez(stream, **arrays)


def _check_finite(arrays: dict[str, NDArray[Any]], step: int) -> None:
    for name, array in arrays.items():
        if not np.isfinite(array).all():
            raise NumericalError(f"`{name}` is not finite after step {step}. {ADVICE}")


def read_checkpoint(folder: Path, key: str | None = None) -> RunState | None:
    """Return the state stored in `folder`; None unless it is complete, and of the run with `key` where one is given."""
    path = folder / CHECKPOINT_FILE
    try:
        record = _read_record(path)
        if record["version"] != VERSION or (key is not None and record["key"] != key):
            return None
        arrays = read_arrays(path, _ARRAYS, optional=_OPTIONAL_ARRAYS, advice=_ADVICE)
        return _state_from(arrays, record)
    except (FormatError, _Damaged):
        return None


def read_progress(folder: Path) -> dict[str, Any] | None:
    """Return the progress of the run in `folder`, without its arrays; None when there is no complete checkpoint.

    Returns
    -------
    dict
        ``step``, ``curve`` (list of dict), ``wall_seconds`` and ``cpu_seconds``, as JSON values.
    """
    try:
        record = _read_record(folder / CHECKPOINT_FILE)
        points = [asdict(point) for point in _curve(record)]
    except (FormatError, _Damaged):
        return None
    return {"curve": points, **{name: record[name] for name in ("step", "wall_seconds", "cpu_seconds")}}


def delete_old_runs(folder: Path, *, keep: str) -> None:
    """Delete the checkpoints in `folder`, one folder per run, except those of `keep` and of the two latest other runs.

    A user who tries another preset and returns to the first one resumes its run.
    """
    others = [path for path in folder.glob("*") if path.name != keep]
    for old in sorted(others, key=_written_at, reverse=True)[N_OTHER_RUNS_KEPT:]:
        delete_derived(folder, old.name)


def latest_run(folder: Path) -> Path | None:
    """Return the folder of the run in `folder` with the latest checkpoint, None when there is no checkpoint."""
    return max((path for path in folder.glob("*") if (path / CHECKPOINT_FILE).is_file()), key=_written_at, default=None)


def _written_at(run: Path) -> float:
    """Return the time when the checkpoint of a run was written, 0 without a checkpoint."""
    file = run / CHECKPOINT_FILE
    return file.stat().st_mtime if file.is_file() else 0.0


class _Damaged(ValueError):
    """Values of a checkpoint that contradict each other."""


def _read_record(path: Path) -> dict[str, Any]:
    """Return the values that are not arrays; raises `FormatError` or `_Damaged` unless all are usable."""
    text = str(read_arrays(path, {"record": _ARRAYS["record"]}, advice=_ADVICE)["record"])
    record: dict[str, Any] = parse_json(text, _RECORD, source=str(path), advice=_ADVICE)
    counts = ("step", "neighbours_step", "wall_seconds", "cpu_seconds", "sh_limit")
    if any((record[name] or 0) < 0 for name in counts) or any(step < 0 for step in record["adam_steps"].values()):
        raise _Damaged
    if any(not _is_number(trial["what"]) for trial in record["trials"]):
        raise _Damaged
    return record


def _curve(record: dict[str, Any]) -> list[CurvePoint]:
    names = [one.name for one in fields(CurvePoint)]
    curve = [CurvePoint(**{name: _nan_if_none(point[name]) for name in names}) for point in record["curve"]]
    steps = [point.step for point in curve]
    if steps != sorted(set(steps)) or (steps and not 0 <= steps[0] <= steps[-1] <= record["step"]):
        raise _Damaged
    return curve


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdecimal() and len(text) < 10


def _is_mask(mask: NDArray[np.bool_]) -> bool:
    return mask.ndim == 2 and mask.size > 0 and max(mask.shape) <= _MAX_MASK_SIDE


def _are_rows(neighbours: NDArray[np.int32]) -> bool:
    return neighbours.size > 0 and 0 <= neighbours.min() <= neighbours.max() < len(neighbours)


def _nan_if_none(value: Any) -> Any:
    return math.nan if value is None else value


def _state_from(arrays: dict[str, NDArray[Any]], record: dict[str, Any]) -> RunState:
    """Return the state; raises `_Damaged` when its values contradict each other."""
    # The kernels of the rasterizer rely on the order of the values in memory.
    arrays = {name: np.ascontiguousarray(values) for name, values in arrays.items()}
    names = [name for name in NAMES if f"value.{name}" in arrays]
    degree = record["sh_limit"]
    neighbours = arrays.get("neighbours")
    masks = {name.removeprefix(TRANSIENT_MASK_PREFIX): mask for name, mask in arrays.items() if mask.dtype == bool}
    if (
        len(arrays["value.means"]) == 0
        or ("value.sh_rest" in arrays and arrays["value.sh_rest"].shape[1] not in (3, 8, 15))
        or (neighbours is not None and not _are_rows(neighbours))
        or any(not _is_number(number) or not _is_mask(mask) for number, mask in masks.items())
    ):
        raise _Damaged

    def moments(name: str) -> AdamState:
        values = arrays["exposure" if name == "exposure" else f"value.{name}"]
        first, second = arrays.get(f"first.{name}"), arrays.get(f"second.{name}")
        if first is None or second is None or name not in record["adam_steps"]:
            raise _Damaged
        if not first.shape == second.shape == values.shape or (second < 0).any():
            raise _Damaged
        return AdamState(torch.from_numpy(first), torch.from_numpy(second), record["adam_steps"][name])

    state = RunState(
        parameters=Parameters(
            {name: torch.from_numpy(arrays[f"value.{name}"]) for name in names}, {n: moments(n) for n in names}
        ),
        exposure=torch.from_numpy(arrays["exposure"]),
        exposure_moments=moments("exposure"),
        step=record["step"],
        sh_limit=degree,
        trials=[
            Trial(**{one.name: _nan_if_none(trial[one.name]) for one in fields(Trial)}) for trial in record["trials"]
        ],
        transient_masks={int(number): mask for number, mask in masks.items()},
        neighbours=None if neighbours is None else torch.from_numpy(neighbours),
        neighbours_step=record["neighbours_step"],
        curve=_curve(record),
        guards=Counter(record["guards"]),
        wall_seconds=float(record["wall_seconds"]),
        cpu_seconds=float(record["cpu_seconds"]),
    )
    if degree is not None and degree > state.parameters.sh_degree:
        raise _Damaged
    return state


def continues(state: RunState, begun: RunState, *, n_steps: int) -> bool:
    """Return whether a stored state can be one of the run that begins with `begun` and makes at most `n_steps` steps.

    The key of a checkpoint proves that it was written by the same run, unless another program wrote it.
    """
    values, first = state.parameters.values, begun.parameters.values
    return (
        state.step <= n_steps
        and (state.step < n_steps or bool(state.curve) and state.curve[-1].step == state.step)
        and state.exposure.shape == begun.exposure.shape
        and (state.sh_limit is None) == (begun.sh_limit is None)
        and set(values) | {"sh_rest"} == set(first) | {"sh_rest"}
        and all(values[name].shape[1:] == first[name].shape[1:] for name in values if name != "sh_rest")
        and state.parameters.sh_degree <= begun.parameters.sh_degree
        and (state.sh_limit is not None or state.parameters.sh_degree == begun.parameters.sh_degree)
        and all(number < len(begun.exposure) for number in state.transient_masks)
    )
