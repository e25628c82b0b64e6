"""Runs one stage of the pipeline, or reuses what an earlier run stored when that is intact."""

from __future__ import annotations

import contextlib
import re
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from ..core.errors import Cancelled
from ..core.events import Emit, Event, Progress, StageFinished, StageStarted, StopCheck, Warned
from ..core.files import delete_derived
from ..core.parts import part
from ..core.system import PeakMemory, cpu_seconds
from ..project.folder import ProjectFolder
from ..project.provenance import describe_run

BEGUN = "begun"
"""Name in ``project.json`` of the stage that was begun last and its key: what it took is then not measured whole."""


@dataclass(frozen=True)
class StageRunner:
    """Runs the stages of one project.

    Attributes
    ----------
    project : ProjectFolder
        Held for writing.
    emit, should_stop
        See `engine.core.events`.
    computed : list of str
        Stages that this run computed, in order; the others were reused.
    """

    project: ProjectFolder
    emit: Emit
    should_stop: StopCheck
    computed: list[str] = field(default_factory=list)

    def run(
        self,
        stage: str,
        key: str,
        compute: Callable[[], dict[str, Any]],
        outputs: Collection[Path] = (),
        *,
        settings: Mapping[str, Any],
    ) -> None:
        """Run `compute` unless `stage` is done with this `key` and its `outputs` are intact; store figures and cost.

        `settings` are the parameters of the stage, recorded with versions, commit and time.

        Outputs that are damaged or missing are said, and deleted before `compute` makes them again.

        Raises
        ------
        Cancelled
            When `should_stop` returned True before the stage began; otherwise what `compute` raises.
        """
        if self.should_stop():
            raise Cancelled(f"Stopped before the stage {stage!r}. Run the same command again to continue.")
        self.emit(StageStarted(stage))
        wall, cpu = time.perf_counter(), cpu_seconds()
        done = self.project.stage_is_done(stage, key)
        damaged = self._damaged(stage, outputs) if done else {}
        reused = done and not damaged
        if not reused:
            # What is made again may be quick, as training from its last checkpoint is: no measure of the stage's cost.
            continued = bool(damaged) or self.project.get(BEGUN) == [stage, key]
            # Reading photos leaves nothing half-done, and may be refused, which must change nothing in the project.
            if stage != "photos":
                self.project.put(BEGUN, [stage, key])
            for name, problem in damaged.items():
                self.emit(Warned(f"{name} {problem}; it is made again."))
                delete_derived(self.project.path, *PurePosixPath(name).parts)
            with PeakMemory.of() as peak:
                figures = compute()
            with part("writing"):
                self.project.finish_stage(
                    stage,
                    key,
                    wall_seconds=time.perf_counter() - wall,
                    cpu_seconds=cpu_seconds() - cpu,
                    figures=figures,
                    peak_memory=peak.bytes,
                    continued=continued,
                    outputs=outputs,
                    run=describe_run(settings),
                )
            self.computed.append(stage)
        self.emit(StageFinished(stage, time.perf_counter() - wall, reused))

    def _damaged(self, stage: str, outputs: Collection[Path]) -> dict[str, str]:
        """Return the outputs that are missing or damaged, and in which way."""
        damaged = self.project.damaged_outputs(stage)
        recorded = self.project.recorded_outputs(stage)
        names = [path.relative_to(self.project.path).as_posix() for path in outputs]
        return damaged | {name: "is not recorded" for name in names if name not in recorded}

    def before_replacing_outputs(self, stage: str) -> None:
        """Mark `stage` as not done before its files are replaced: after a kill they must not count as done."""
        self.project.forget_stages([stage])

    def key_of(self, stage: str) -> str | None:
        """Return the key that `stage` was done with, None while it is not done."""
        record = self.project.stage_record(stage)
        return None if record is None else record["key"]


@contextlib.contextmanager
def parts_by_message(emit: Emit) -> Iterator[Emit]:
    """Yield an `emit` by which each message of progress, without its numbers, names the part that begins there."""
    with contextlib.ExitStack() as present:
        shown = ""

        def emit_and_book(event: Event) -> None:
            nonlocal shown
            name = " ".join(re.sub(r"\d+( of)?", "", event.message).split()) if isinstance(event, Progress) else ""
            if name not in ("", shown):
                present.close()
                present.enter_context(part(name))
                shown = name
            emit(event)

        yield emit_and_book
