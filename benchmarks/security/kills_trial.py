"""One trial: start a command, kill it at a random moment, check what it left, run it to its end, compare."""

from __future__ import annotations

import random
import shutil
import signal
import time
from dataclasses import dataclass, field
from pathlib import Path

from engine.core.errors import HeritageError

from .kills_checks import damaged_files, files_of, leftovers, objects_of, opened_copy, scene_of
from .kills_fixture import Fixture, Kind, Reference
from .kills_process import EngineRun, wait_for_write

MAX_STOP_SECONDS = 30.0
"""Longest time from SIGTERM to the end of the process that is accepted."""
_AT_WRITE_SHARE = 0.25
"""Share of the trials in which the random moment is followed by waiting until a file is being written."""
_AT_WRITE_SECONDS = 2.0
_KILLED_AGAIN_SHARE = 0.25
_MAX_ATTEMPTS = 8
_CANCELLED = 130


@dataclass
class Trial:
    """One kill and what came of it.

    Attributes
    ----------
    kind : Kind
    number : signal
        SIGKILL or SIGTERM.
    seed : int
        Of the random moments.
    moment : str
        When the signal was sent, for the protocol.
    stop_seconds : float
        From the signal to the end of the process.
    ended_itself : bool
        Whether the command ended with its result although SIGTERM had been sent: no safe point was left.
    killed_again : bool
        Whether the continuation was killed too, and continued a second time.
    continued : bool
        Whether the last continuation ended with exit code 0.
    identical : bool
        Whether the result has the same bytes as that of an uninterrupted run.
    orphans, damaged, lost, other : list of str
        What was wrong: processes that were left, files that cannot be read, what existed before and is gone, all else.
    """

    kind: Kind
    number: signal.Signals
    seed: int
    moment: str = ""
    stop_seconds: float = 0.0
    ended_itself: bool = False
    killed_again: bool = False
    continued: bool = False
    identical: bool = False
    orphans: list[str] = field(default_factory=list)
    damaged: list[str] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)
    other: list[str] = field(default_factory=list)
    _stored: list[str] = field(default_factory=list)
    """Hashes of the objects that kills have left."""

    @property
    def problems(self) -> list[str]:
        """Everything that was wrong."""
        found = [*self.orphans, *self.damaged, *self.lost, *self.other]
        if not self.moment:
            found.append("the command was always over before the kill")
        elif not self.continued:
            found.append("it could not be continued")
        elif not self.identical:
            found.append("the result differs from that of an uninterrupted run")
        return found

    def run(self, fixture: Fixture, folder: Path) -> None:
        """Do the trial in `folder`, which is deleted when nothing was wrong."""
        rng = random.Random(self.seed)
        reference = fixture.references[self.kind.name]
        before = objects_of(fixture.state(self.kind)) if self.kind.state else {}
        for attempt in range(_MAX_ATTEMPTS):
            shutil.rmtree(folder, ignore_errors=True)
            # The uninterrupted run may have been slower than this one, on a machine with other work.
            run = self._kill(fixture, folder, rng, self.number, latest=0.5**attempt)
            if run is not None:
                break
        else:
            return
        project = folder / "project"
        self._check_end(run)
        self._check_project(project, run, before, reference)
        if rng.random() < _KILLED_AGAIN_SHARE:
            again = self._kill(fixture, folder, rng, signal.SIGKILL)
            self.killed_again = again is not None
            if again is not None:
                self._check_project(project, again, before, reference)
        if self.kind.may_repeat or not set(reference.objects.values()) <= set(self._stored):
            self._continue(fixture, folder)
        else:
            self.continued = True
        if self.continued:
            self._compare(fixture, folder, reference)
        if not self.problems:
            shutil.rmtree(folder)

    def _kill(
        self, fixture: Fixture, folder: Path, rng: random.Random, number: signal.Signals, *, latest: float = 1.0
    ) -> EngineRun | None:
        """Start the command and send the signal in its stage; None when the process was over before.

        The moment is random in the first part `latest` of the time that an uninterrupted run took.
        """
        share, at_write = latest * rng.random(), rng.random() < _AT_WRITE_SHARE
        run = fixture.start(self.kind, folder)
        if not run.wait_until_begun(self.kind.stage):
            run.wait()
            return None
        begin = time.monotonic()
        time.sleep(share * fixture.references[self.kind.name].seconds)
        if at_write:
            wait_for_write(folder, _AT_WRITE_SECONDS, gone=lambda: run.process.poll() is not None)
        sent = time.monotonic()
        if run.process.poll() is not None:
            run.wait()
            return None
        run.process.send_signal(number)
        run.wait()
        if number == signal.SIGKILL and run.process.returncode == 0:
            return None  # it ended by itself between the look at it and the signal
        self.moment += f"{number.name} {sent - begin:.3f} s after the beginning, in {run.stage or 'the command'}; "
        if number == signal.SIGTERM:
            self.stop_seconds = time.monotonic() - sent
        return run

    def _check_end(self, run: EngineRun) -> None:
        code = run.process.returncode
        errors = run.errors.read_text(encoding="utf-8", errors="replace").splitlines()
        if any("Traceback" in line for line in errors):
            self.other.append(f"a traceback: {errors[-1]}")
        if self.number == signal.SIGKILL:
            if code != -signal.SIGKILL:
                self.other.append(f"exit code {code} after SIGKILL")
            return
        if self.stop_seconds > MAX_STOP_SECONDS:
            self.other.append(f"it ended {self.stop_seconds:.0f} s after SIGTERM")
        if code == 0 and run.of_kind("finished"):
            self.ended_itself = True
            return
        sentences = [event["message"] for event in run.of_kind("error")]
        if code != _CANCELLED:
            self.other.append(f"exit code {code} after SIGTERM: {sentences}")
        elif len(sentences) != 1 or "\n" in sentences[0]:
            self.other.append(f"not one sentence after SIGTERM: {sentences}")
        # The only line of standard error says that the signal was understood.
        if len(errors) > 1:
            # Not all of them: the table is committed, and stack traces have paths of this machine.
            self.other.append(f"{len(errors)} lines on standard error, the first: {errors[0][:120]}")

    def _check_project(self, project: Path, run: EngineRun, before: dict[str, str], reference: Reference) -> None:
        """Check what a kill left."""
        self.orphans += run.orphans()
        if not project.exists():
            if self.kind.state:
                self.lost.append("the project")
            return
        self.damaged += damaged_files(project)
        try:
            with opened_copy(project) as copy:
                now = {} if copy is None else objects_of(copy)
        except (HeritageError, OSError, ValueError) as error:
            self.lost.append(f"objects that cannot be read: {error}")
            return
        self._stored += now.values()
        for object_id, content in before.items():
            if object_id not in now:
                self.lost.append(f"the object {object_id}")
            elif now[object_id] not in (content, reference.objects.get(object_id)):
                self.damaged.append(f"the object {object_id} is neither what it was nor what the command makes of it")

    def _continue(self, fixture: Fixture, folder: Path) -> None:
        run = fixture.start(self.kind, folder)
        code = run.wait()
        self.continued = code == 0
        self.orphans += run.orphans()
        if code != 0:
            self.other.append(f"the continuation ended with exit code {code}: {run.of_kind('error')}")

    def _compare(self, fixture: Fixture, folder: Path, reference: Reference) -> None:
        """Compare the result with that of an uninterrupted run."""
        project = folder / "project"
        self.damaged += damaged_files(project)
        self.other += [f"left behind: {name}" for name in leftovers(project)]
        differences = self._differences(folder, reference)
        self.identical = not differences
        self.other += [f"different: {name}" for name in differences]

    def _differences(self, folder: Path, reference: Reference) -> list[str]:
        project = folder / "project"
        if self.kind.reconstructs:
            now = scene_of(project)
            different = [name for name in {*now, *reference.scene} if now.get(name) != reference.scene.get(name)]
            names, wanted = files_of(project), files_of(reference.project)
            self.lost += [f"the file {name}" for name in wanted - names]
            return [*different, *(f"the file {name} is not in an uninterrupted project" for name in names - wanted)]
        objects = objects_of(project)
        missing = [name for name, content in reference.objects.items() if content not in objects.values()]
        # A killed run may have stored its result before it was killed: then the repetition finds it again.
        known = {*reference.objects.values(), *self._stored}
        different = [f"object {name}" for name, content in objects.items() if content not in known]
        exported = next((file.read_bytes() for file in folder.glob("exported.*")), b"")
        return [f"object {name}" for name in missing] + different + ["export"] * (exported != reference.exported)
