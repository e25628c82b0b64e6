"""State of one photo folder in the coordinator: how far it is, what was tried, what is to be reported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...core.errors import DiskError, EnvironmentProblem, ModelFileError, SettingsError
from ...pipeline.stages import STAGES

WORKER_PROBLEMS = {error.__name__ for error in (DiskError, EnvironmentProblem, ModelFileError)}
"""Errors that another worker may not have."""


@dataclass
class FolderState:
    """One photo folder of a batch.

    Attributes
    ----------
    number : int
    photos, out : Path
        Photo folder, and project folder.
    state : str
        ``waiting``, ``running``, ``done``, ``failed`` or ``stopped``.
    command : tuple of str
        A command of the engine with absolute paths, where it is not ``reconstruct`` with the options of the batch.
    stages : tuple of str
        Stages that are tasks, in order; a command other than ``reconstruct`` is one task.
    stage : str
        The stage that is next.
    done : list of str
        Stages whose results the project has.
    computed : list of str
        Stages that this batch computed, in order; a stage that stands here twice was done twice.
    forecast : dict
        Expected memory and seconds by stage, once the photos were read.
    tries : int
        Of the present stage.
    memory : int
        Bytes that the present stage reserves.
    restarts : int
        How often a stage began again because its worker, or the scheduler, was lost.
    notes : list of str
        Sentences for the summary.
    error, error_type : str
        Why it failed, and the name of the engine's exception.
    message : str
    outputs : dict
        What the last task said at its end, see `engine.core.events.Finished`.
    seconds, cpu_seconds : float
        Sum over its tasks; killed ones do not report their cost.
    busy_since : float or None
        When another job was first found working in it.
    """

    number: int
    photos: Path
    out: Path
    state: str = "waiting"
    command: tuple[str, ...] = ()
    stages: tuple[str, ...] = STAGES
    stage: str = STAGES[0]
    done: list[str] = field(default_factory=list)
    computed: list[str] = field(default_factory=list)
    forecast: dict[str, dict[str, Any]] = field(default_factory=dict)
    tries: int = 0
    memory: int = 0
    restarts: int = 0
    notes: list[str] = field(default_factory=list)
    error: str = ""
    error_type: str = ""
    message: str = ""
    outputs: dict[str, Any] = field(default_factory=dict)
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    busy_since: float | None = None

    @property
    def name(self) -> str:
        """Name of the project folder."""
        return self.out.name

    @property
    def ended(self) -> bool:
        """Whether nothing more is done."""
        return self.state in ("done", "failed", "stopped")

    def note(self, sentence: str) -> bool:
        """Add a sentence for the summary, once; return whether it is new."""
        if sentence in self.notes:
            return False
        self.notes.append(sentence)
        return True

    def advance(self) -> None:
        """Set the next stage after an answer: the first that is expected and not done, the report at the end.

        When all stages are done already, one task checks them all.
        """
        if self.stage == self.stages[-1]:
            self.state = "done"
            return
        after = self.stages[self.stages.index(self.stage) + 1 :]
        open_stages = [stage for stage in after if stage in self.forecast and stage not in self.done]
        self.stage, self.tries = (open_stages or [self.stages[-1]])[0], 0

    def expected_memory(self, photos_memory: int) -> tuple[int, int]:
        """Return the expected and the high forecast of the bytes that the next task takes.

        A task may do again what changed before its stage, so this is the largest forecast of all stages up to it.
        """
        if not self.forecast:
            return photos_memory, photos_memory
        known = [one for stage, one in self.forecast.items() if STAGES.index(stage) <= STAGES.index(self.stage)]
        # Where this task does more than its own stage, an earlier one may be the largest.
        skipped = self.stage == STAGES[-1] and not self.computed
        used = known if skipped or self.stage not in self.forecast else [self.forecast[self.stage]]
        return max(int(one["memory"]) for one in used), max(int(one["memory_high"]) for one in used)

    def share_done(self) -> float:
        """Return how much of the folder is done, by its forecast."""
        if self.state == "done":
            return 1.0
        total = sum(one["cpu_seconds"] for one in self.forecast.values())
        done = sum(one["cpu_seconds"] for stage, one in self.forecast.items() if stage in self.done)
        return done / total if total > 0 else 0.0


def folder_states(folders: Sequence[Path], out: Path) -> list[FolderState]:
    """Return the folders of a batch with their projects below `out`.

    Raises
    ------
    SettingsError
        When two folders would have the same project, or a folder does not exist.
    """
    states: list[FolderState] = []
    names: dict[str, Path] = {}
    for number, folder in enumerate(folders):
        path = folder.resolve()
        if not path.exists():
            raise SettingsError(f"{folder} does not exist. Give the folders with the photos of each scene.")
        name = path.stem if path.is_file() else path.name
        # Compared as the file systems of Windows and macOS do.
        if name.casefold() in names:
            raise SettingsError(
                f"{names[name.casefold()]} and {path} have the same name, and so would their projects. Rename one."
            )
        names[name.casefold()] = path
        states.append(FolderState(number, path, out.resolve() / name))
    return states
