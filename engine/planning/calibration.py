"""How fast this machine is: a short benchmark on first use, corrected by what every later run really took.

One JSON file in the user's cache folder, keyed by machine and package versions. A damaged or foreign file is set aside
with a log line and made anew.
"""

from __future__ import annotations

import importlib.metadata
import json
import logging
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from ..errors import DiskError
from ..machine import Machine
from ..project_folder import stage_key, write_json

__all__ = ["CALIBRATION_VARIABLE", "Benchmark", "Calibration", "Learned", "calibration_file", "load_calibration"]

_log = logging.getLogger(__name__)

CALIBRATION_VARIABLE = "GAUSSIAN_HERITAGE_CALIBRATION"
"""Names another file than that in the user's cache folder."""

_VERSION = 2
_PACKAGES = ("torch", "numba", "numpy", "pycolmap", "onnxruntime")
_NEWEST = 0.4
"""Weight of a run's outcome in the mean; the first ones weigh more, see `Learned.after`."""
_LARGEST_RATIO = math.log(8.0)
"""An outcome further off than this is no matter of speed: part of the stage was kept from before, or it was paused."""
_LEAST_SECONDS = 2.0
"""Shorter stages say more about starting up than about the formula."""

PRIOR_DEVIATION = {
    "photos": {"cpu": 0.4, "wall": 0.3, "memory": 0.3},
    "cameras": {"cpu": 0.3, "wall": 0.15, "memory": 0.25},
    "masks": {"cpu": 0.2, "wall": 0.15, "memory": 0.15},
    "training": {"cpu": 0.2, "wall": 0.15, "memory": 0.15},
    "objects": {"cpu": 0.5, "wall": 0.2, "memory": 0.25},
    "report": {"cpu": 0.4, "wall": 0.2, "memory": 0.25},
}
"""Standard deviations of log(actual / formula) before any run on a machine was seen."""


@dataclass(frozen=True)
class Learned:
    """Exponentially weighted mean and variance of log(actual / formula) over `n` runs."""

    mean: float
    variance: float
    n: int = 0

    def after(self, ratio: float) -> Learned:
        """Return what one more outcome `ratio` = log(actual / formula) makes of it.

        Notes
        -----
        With weight a = max(0.4, 1 / (n + 1.4)): 0.71 for the first, 0.42 for the second, 0.4 from then on. Mean m and
        variance v become m + a d and (1 - a) (v + a d^2) for d = ratio - m (Finch 2009, section 4).
        """
        weight = max(_NEWEST, 1.0 / (self.n + 1.4))
        difference = ratio - self.mean
        return Learned(
            self.mean + weight * difference, (1.0 - weight) * (self.variance + weight * difference**2), self.n + 1
        )


@dataclass(frozen=True)
class Benchmark:
    """What the benchmark measured, CPU seconds; see `benchmark.measure_speed`.

    Attributes
    ----------
    training_step : float
    features : float
        SIFT on two pictures, and matching them.
    sam_encode : float or None
        None where the model is not there.
    libraries : int or None
        Bytes of a process that has only loaded them (torch built for CUDA holds a GB more than for the CPU); None where
        the system cannot tell.
    rasterizer : str
        Which version of our rasterizer was measured; another one is measured anew.
    """

    training_step: float
    features: float
    sam_encode: float | None
    libraries: int | None
    rasterizer: str


REFERENCE = Benchmark(training_step=0.030, features=2.1, sam_encode=1.85, libraries=404_000_000, rasterizer="")
"""The same figures on the machine that the formulas were fitted on."""


@dataclass
class Calibration:
    """What is known of this machine.

    Attributes
    ----------
    file : Path
    key : str
        Of machine and package versions.
    benchmark : Benchmark or None
        None when none was made yet.
    outcomes : dict
        Stage, then ``cpu``, ``wall`` or ``memory``, to `Learned`.
    n_runs : int
        Runs that were learned from.
    """

    file: Path
    key: str
    benchmark: Benchmark | None = None
    outcomes: dict[str, dict[str, Learned]] = field(default_factory=dict)
    n_runs: int = 0

    def slowness(self, stage: str) -> float:
        """Return how many times slower than the reference machine this one is at a stage's kind of work."""
        measured = self.benchmark
        if measured is None:
            return 1.0
        if stage in ("training", "report"):
            return measured.training_step / REFERENCE.training_step
        if stage in ("masks", "objects") and measured.sam_encode is not None:
            assert REFERENCE.sam_encode is not None
            return measured.sam_encode / REFERENCE.sam_encode
        return measured.features / REFERENCE.features

    @property
    def more_memory(self) -> int:
        """Bytes that the libraries hold here beyond what they hold on the reference machine."""
        if self.benchmark is None or self.benchmark.libraries is None:
            return 0
        assert REFERENCE.libraries is not None
        return self.benchmark.libraries - REFERENCE.libraries

    def learned(self, stage: str, what: str) -> Learned:
        """Return the correction of a stage's formula for ``cpu``, ``wall`` or ``memory``."""
        known = self.outcomes.get(stage, {}).get(what)
        return known or Learned(0.0, PRIOR_DEVIATION[stage][what] ** 2)

    def learn(self, stage: str, what: str, *, formula: float, actual: float | None) -> None:
        """Take in one outcome; it is passed over where it says nothing about the formula."""
        if actual is None or not (formula > 0.0 and actual > 0.0):
            return
        if what != "memory" and max(formula, actual) < _LEAST_SECONDS:
            return
        ratio = math.log(actual / formula)
        if abs(ratio) > _LARGEST_RATIO:
            _log.info("%s took %.3g times the expected %s: not learned from", stage, math.exp(ratio), what)
            return
        self.outcomes.setdefault(stage, {})[what] = self.learned(stage, what).after(ratio)

    def save(self) -> None:
        """Write the file; a disk that refuses costs only the next forecast some accuracy and is logged."""
        machines = _read(self.file)
        machines[self.key] = {
            "benchmark": asdict(self.benchmark) if self.benchmark else None,
            "outcomes": {s: {w: asdict(known) for w, known in of.items()} for s, of in self.outcomes.items()},
            "n_runs": self.n_runs,
        }
        try:
            write_json(self.file, {"version": _VERSION, "machines": machines})
        except DiskError as error:
            _log.warning("What this run took is not kept for the next forecast: %s", error)


def calibration_file() -> Path:
    """Return where the calibration lies: `CALIBRATION_VARIABLE`, else beside the models in the user's cache."""
    named = os.environ.get(CALIBRATION_VARIABLE)
    if named:
        return Path(named)
    from ..models import models_folder

    return models_folder().parent / "calibration.json"


def load_calibration(
    machine: Machine,
    *,
    rasterizer: str,
    measure: Callable[[], Benchmark],
    file: Path | None = None,
) -> Calibration:
    """Return what is known of this machine; a benchmark is made on first use and for a new rasterizer.

    Parameters
    ----------
    machine : Machine
    rasterizer : str
        Version of the rasterizer that is there.
    measure : callable
        Makes the benchmark.
    file : Path, optional
        `calibration_file` by default.
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
    """Return the machines in the file; none when it is missing, damaged or of another version."""
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        _log.warning("%s cannot be read (%s); this machine is measured anew", file, error)
        return {}
    if not isinstance(data, dict) or data.get("version") != _VERSION or not isinstance(data.get("machines"), dict):
        _log.warning("%s is of another version; this machine is measured anew", file)
        return {}
    machines: dict[str, Any] = data["machines"]
    return machines


def _parse(empty: Calibration, stored: Any) -> Calibration:
    """Return the stored calibration, or `empty` when its values are not what they should be."""
    try:
        benchmark = Benchmark(**stored["benchmark"]) if stored["benchmark"] else None
        outcomes = {
            stage: {what: _learned(known) for what, known in of.items() if what in PRIOR_DEVIATION[stage]}
            for stage, of in stored["outcomes"].items()
            if stage in PRIOR_DEVIATION
        }
        times = (benchmark.training_step, benchmark.features) if benchmark else ()
        if not all(math.isfinite(seconds) and seconds > 0 for seconds in times):
            raise ValueError("a time that is none")
        return replace(empty, benchmark=benchmark, outcomes=outcomes, n_runs=int(stored["n_runs"]))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        _log.warning("%s holds something unreadable (%r); this machine is measured anew", empty.file, error)
        return empty


def _learned(known: Mapping[str, Any]) -> Learned:
    learned = Learned(float(known["mean"]), float(known["variance"]), int(known["n"]))
    if not (math.isfinite(learned.mean) and abs(learned.mean) <= _LARGEST_RATIO and 0 <= learned.variance < 100):
        raise ValueError("a correction that is none")
    return learned
