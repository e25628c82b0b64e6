"""Calibration of the forecasts for this machine: a short benchmark on first use, corrected by every later run.

It is one JSON file in the user's cache folder, keyed by machine and package versions. A file that is damaged or has
another version is ignored with a log line and replaced.
"""

from __future__ import annotations

import importlib.metadata
import logging
import math
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from ...core.errors import DiskError, FormatError
from ...core.files import check, optional, read_json, write_json
from ...core.system import Machine
from ...project.folder import stage_key

_LOG = logging.getLogger(__name__)

CALIBRATION_VARIABLE = "GAUSSIAN_HERITAGE_CALIBRATION"
"""Environment variable with the path of the calibration file, for another place than the user's cache folder."""

_VERSION = 2
"""Version of the file's format."""
_PACKAGES = ("torch", "numba", "numpy", "pycolmap", "onnxruntime")
"""Packages whose versions are part of the key."""
_NEW_OUTCOME_WEIGHT = 0.4  # chosen on museum_room, sakharov_statue32
"""Weight of a new outcome in the mean. The first outcomes weigh more, see `Correction.updated`."""
_FIRST_OUTCOMES = 1.4
"""Runs that the prior counts as, so that the first outcome does not replace it whole."""
_MAX_LOG_RATIO = math.log(8.0)  # chosen on museum_room, sakharov_statue32
"""Largest |log(actual / formula)| that is used. Beyond it the cause is not the machine's speed: the run was paused, or
part of the stage was reused from an earlier run."""
_MAX_CARD_LOG_RATIO = math.log(100.0)
"""The same for training on a graphics card: its formula does not know how fast the card is."""
_MIN_SECONDS = 2.0  # chosen on museum_room, sakharov_statue32
"""Shortest stage that is used, in seconds. In shorter ones the start-up dominates."""

_ENCODING_SHARE = 0.62  # chosen on museum_room
"""Share of SAM's time for a photo that its encoder takes on the reference machine. The rest decodes clicks, which is as
much slower on another machine as COLMAP is."""

_BENCHMARK = {
    "training_step": float, "features": float, "sam_encode": (float, None), "libraries": (int, None), "rasterizer": str
}  # fmt: skip
_MACHINE = {
    "benchmark": (_BENCHMARK, None),
    "outcomes": {str: {str: {"mean": float, "variance": float, "n": int}}},
    "n_runs": int,
}
"""What is stored of a machine."""
_SECONDS = (1e-6, 1e4)
"""Shortest and longest time in CPU seconds that a part of the benchmark can take."""
_MAX_LIBRARY_BYTES = 1 << 40
_MAX_VARIANCE = 100.0

PRIOR_DEVIATION = {
    "photos": {"cpu": 0.4, "wall": 0.3, "memory": 0.3},
    "cameras": {"cpu": 0.3, "wall": 0.15, "memory": 0.25},
    "masks": {"cpu": 0.2, "wall": 0.15, "memory": 0.15},
    "training": {"cpu": 0.2, "wall": 0.15, "memory": 0.15},
    "objects": {"cpu": 0.5, "wall": 0.2, "memory": 0.25},
    "report": {"cpu": 0.4, "wall": 0.2, "memory": 0.25},
}  # chosen on museum_room, sakharov_statue32
"""Standard deviations of log(actual / formula) per stage, before any run on a machine is known."""
_CARD_DEVIATION = {"cpu": 0.6, "wall": 0.6, "memory": 0.3}
"""The same for training on a graphics card."""
_ON_CARD = "training on "


def outcome_name(stage: str, device: str) -> str:
    """Return the name under which outcomes of a stage are kept: training has its own on each graphics card."""
    return f"{_ON_CARD}{device}" if stage == "training" and device != "cpu" else stage


def _deviations(outcome: str) -> dict[str, float]:
    """Return the standard deviations of a stage, or of training on a card; empty for an unknown name."""
    return _CARD_DEVIATION if outcome.startswith(_ON_CARD) else PRIOR_DEVIATION.get(outcome, {})


def _max_log_ratio(outcome: str) -> float:
    return _MAX_CARD_LOG_RATIO if outcome.startswith(_ON_CARD) else _MAX_LOG_RATIO


@dataclass(frozen=True)
class Correction:
    """Exponentially weighted mean and variance of log(actual / formula) over `n` runs."""

    mean: float
    variance: float
    n: int = 0

    def updated(self, ratio: float) -> Correction:
        """Return the correction with one more outcome, `ratio` = log(actual / formula).

        Notes
        -----
        The weight is a = max(`_NEW_OUTCOME_WEIGHT`, 1 / (n + `_FIRST_OUTCOMES`)). Mean m and variance v become m + a d
        and (1 - a) (v + a d^2) for d = ratio - m (Finch 2009, section 4).
        """
        weight = max(_NEW_OUTCOME_WEIGHT, 1.0 / (self.n + _FIRST_OUTCOMES))
        difference = ratio - self.mean
        return Correction(
            self.mean + weight * difference, (1.0 - weight) * (self.variance + weight * difference**2), self.n + 1
        )


@dataclass(frozen=True)
class Benchmark:
    """Results of `benchmark.measure_speed`; times in CPU seconds.

    Attributes
    ----------
    training_step : float
        One training step.
    features : float
        Detecting SIFT features in two pictures and matching them.
    sam_encode : float or None
        Encoding a picture with SAM; None if the model is missing.
    libraries : int or None
        Bytes of memory of a process that has only loaded the libraries; None if the system does not state it. Torch
        built for CUDA takes a GB more than torch for the CPU.
    rasterizer : str
        Version of the rasterizer that was measured. The benchmark is repeated for another version.
    """

    training_step: float
    features: float
    sam_encode: float | None
    libraries: int | None
    rasterizer: str


REFERENCE = Benchmark(training_step=0.030, features=2.1, sam_encode=1.85, libraries=404_000_000, rasterizer="")
"""The results on the reference machine, on which the formulas were fitted."""


@dataclass
class Calibration:
    """Benchmark and corrections of one machine.

    Attributes
    ----------
    file : Path
        Where the calibration is stored.
    key : str
        Hash of the machine and the package versions.
    benchmark : Benchmark or None
        None before the first benchmark.
    outcomes : dict
        Corrections by `outcome_name` and quantity: ``cpu``, ``wall`` or ``memory``.
    n_runs : int
        Number of runs in the corrections.
    """

    file: Path
    key: str
    benchmark: Benchmark | None = None
    outcomes: dict[str, dict[str, Correction]] = field(default_factory=dict)
    n_runs: int = 0

    def slowdown(self, outcome: str) -> float:
        """Return the CPU time of a stage's kind of work on this machine, divided by that on the reference machine.

        Training and the report render: their measure is a training step. All other work is like COLMAP's, but for what
        SAM encodes. 1 for training on a graphics card, whose formula is for the kind of card.

        Parameters
        ----------
        outcome : str
            By `outcome_name`.
        """
        measured = self.benchmark
        if measured is None or outcome.startswith(_ON_CARD):
            return 1.0
        if outcome in ("training", "report"):
            return measured.training_step / REFERENCE.training_step
        detecting = measured.features / REFERENCE.features
        if outcome == "masks" and measured.sam_encode is not None:
            assert REFERENCE.sam_encode is not None
            return _ENCODING_SHARE * measured.sam_encode / REFERENCE.sam_encode + (1 - _ENCODING_SHARE) * detecting
        return detecting

    @property
    def extra_library_memory(self) -> int:
        """Bytes of memory that the libraries take on this machine beyond those on the reference machine."""
        if self.benchmark is None or self.benchmark.libraries is None:
            return 0
        assert REFERENCE.libraries is not None
        return self.benchmark.libraries - REFERENCE.libraries

    def correction(self, outcome: str, quantity: str) -> Correction:
        """Return the correction of a formula for ``cpu``, ``wall`` or ``memory``: before any run, none with the usual
        deviation."""
        known = self.outcomes.get(outcome, {}).get(quantity)
        return known or Correction(0.0, _deviations(outcome)[quantity] ** 2)

    def add_outcome(self, outcome: str, quantity: str, *, formula: float, actual: float | None) -> None:
        """Add one outcome to the corrections. An outcome that says nothing about the formula is ignored."""
        if actual is None or not (formula > 0.0 and actual > 0.0):
            return
        if quantity != "memory" and max(formula, actual) < _MIN_SECONDS:
            return
        ratio = math.log(actual / formula)
        if abs(ratio) > _max_log_ratio(outcome):
            _LOG.info(
                "%s took %.3g times the expected %s; this run does not correct it", outcome, math.exp(ratio), quantity
            )
            return
        self.outcomes.setdefault(outcome, {})[quantity] = self.correction(outcome, quantity).updated(ratio)

    def save(self) -> None:
        """Write the file. A disk error is only logged: the next forecast is then less accurate."""
        machines = _read(self.file)
        machines[self.key] = {
            "benchmark": asdict(self.benchmark) if self.benchmark else None,
            "outcomes": {
                stage: {quantity: asdict(correction) for quantity, correction in corrections.items()}
                for stage, corrections in self.outcomes.items()
            },
            "n_runs": self.n_runs,
        }
        try:
            write_json(self.file, {"version": _VERSION, "machines": machines})
        except DiskError as error:
            _LOG.warning("The time and memory of this run cannot be kept for the next forecast: %s", error)


def calibration_file() -> Path:
    """Return the calibration file: `CALIBRATION_VARIABLE` if set, else a file beside the models in the user's cache."""
    path = os.environ.get(CALIBRATION_VARIABLE)
    if path:
        return Path(path)
    from ...install.models import models_folder

    return models_folder().parent / "calibration.json"


def load_calibration(
    machine: Machine,
    *,
    rasterizer: str,
    measure: Callable[[], Benchmark],
    file: Path | None = None,
) -> Calibration:
    """Return the calibration of this machine. The benchmark is run on first use and for a new rasterizer.

    Parameters
    ----------
    rasterizer : str
        Version of the installed rasterizer.
    measure : callable
        Runs the benchmark.
    file : Path, optional
        Default: `calibration_file`.
    """
    file = file or calibration_file()
    key = stage_key(machine.name, {name: _version(name) for name in _PACKAGES})[:16]
    stored = _read(file).get(key)
    calibration = Calibration(file, key)
    if stored is not None:
        calibration = _parse(calibration, stored)
    measured = calibration.benchmark
    if measured is None or measured.rasterizer != rasterizer:
        calibration.benchmark = replace(measure(), rasterizer=rasterizer)
        calibration.save()
    return calibration


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _read(file: Path) -> dict[str, Any]:
    """Return the machines in the file whose values are valid; none if it is missing, damaged or of another version."""
    if not os.path.lexists(file):
        return {}
    try:
        data = read_json(file, {"version": int, "machines": optional(dict)}, advice="This machine is measured again.")
    except FormatError as error:
        _LOG.warning("%s", error)
        return {}
    if data["version"] != _VERSION or "machines" not in data:
        _LOG.warning("%s has another version; this machine is measured again", file)
        return {}
    machines = {key: machine for key, machine in data["machines"].items() if _is_valid(machine)}
    if len(machines) < len(data["machines"]):
        _LOG.warning("%s contains unreadable values; their machine is measured again", file)
    return machines


def _is_valid(machine: Any) -> bool:
    """Return whether a stored machine has all values, within their ranges."""
    if check(machine, _MACHINE) is not None:
        return False
    benchmark = machine["benchmark"]
    if benchmark is not None:
        times = [benchmark[name] for name in ("training_step", "features", "sam_encode")]
        if not all(_SECONDS[0] <= seconds <= _SECONDS[1] for seconds in times if seconds is not None):
            return False
        if not 0 <= (benchmark["libraries"] or 0) <= _MAX_LIBRARY_BYTES:
            return False
    corrections = [(stage, one) for stage, found in machine["outcomes"].items() for one in found.values()]
    return machine["n_runs"] >= 0 and all(
        abs(one["mean"]) <= _max_log_ratio(stage) and 0 <= one["variance"] <= _MAX_VARIANCE and one["n"] >= 0
        for stage, one in corrections
    )


def _parse(empty: Calibration, stored: dict[str, Any]) -> Calibration:
    """Return the calibration of a valid stored machine."""
    benchmark, outcomes = stored["benchmark"], stored["outcomes"]
    return replace(
        empty,
        benchmark=Benchmark(**{name: benchmark[name] for name in _BENCHMARK}) if benchmark else None,
        outcomes={
            stage: {
                quantity: Correction(values["mean"], values["variance"], values["n"])
                for quantity, values in corrections.items()
                if quantity in _deviations(stage)
            }
            for stage, corrections in outcomes.items()
            if _deviations(stage)
        },
        n_runs=stored["n_runs"],
    )
