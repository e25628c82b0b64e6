"""Gives the stages of all folders to the workers, tries again what a worker could not do, and says what happened.

Everything that must outlive this process is in the project folders: run again, the batch goes on where it stopped.
"""

from __future__ import annotations

import contextlib
import queue
import time
import uuid
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from distributed import Client, Future

from ... import __version__
from ...core.errors import HeritageError, ModelFileError, ProjectInUse, SettingsError
from ...core.events import Emit, Progress, StageFinished, StageStarted, StopCheck, Warned, from_json_line
from ...project.folder import ProjectFolder
from .cluster import GPU, MEMORY, connected_client, worker_resources
from .folder_state import WORKER_PROBLEMS, FolderState, folder_states
from .settings import BatchSettings
from .shipping import Bundle, mirror, pack, pack_photos
from .stage_task import run_stage, stop_stages, topic_of

_POLL_SECONDS = 0.5
_LOOK_SECONDS = 5.0
"""Seconds between two looks at the workers that are connected."""
_SAY_SECONDS = 2.0
_RUNNING_AT_ONCE = 2
"""Folders that are sent at the same time, for each worker: their files are in memory."""


@dataclass
class BatchResult:
    """Result of a batch.

    Attributes
    ----------
    folders : list of FolderState
    notes : list of str
        Sentences about the whole batch.
    seconds : float
        Wall seconds.
    """

    folders: list[FolderState]
    notes: list[str]
    seconds: float

    @property
    def succeeded(self) -> bool:
        """Whether all folders are done."""
        return all(folder.state == "done" for folder in self.folders)


def run_batch(folders: Sequence[Path], settings: BatchSettings, *, emit: Emit, should_stop: StopCheck) -> BatchResult:
    """Reconstruct every folder; those that fail do not stop the others.

    Parameters
    ----------
    folders : sequence of Path
        Photo folders or videos.
    emit, should_stop
        See `engine.core.events`.

    Raises
    ------
    SettingsError
        When a folder does not exist, or two have the same name.
    EnvironmentProblem
        When the scheduler does not answer.
    """
    begin = time.monotonic()
    states = folder_states(folders, settings.out)
    if settings.ship and any(one.photos.is_file() for one in states):
        raise SettingsError("A video cannot be sent with --ship. Take photos from it first with `frames`.")
    emit(StageStarted("batch"))
    with connected_client(settings) as client:
        coordinator = Coordinator(client, states, settings, emit, should_stop)
        coordinator.run()
    emit(StageFinished("batch", time.monotonic() - begin))
    return BatchResult(states, coordinator.notes, time.monotonic() - begin)


@dataclass
class Coordinator:
    """Gives the tasks of some folders to the workers until all have ended.

    Attributes
    ----------
    client : distributed.Client
    folders : list of FolderState
        Changed while they are worked on.
    settings : BatchSettings
    emit, should_stop
        See `engine.core.events`.
    relay : bool
        Whether the engine's own events are emitted instead of the events of a batch; for one folder.
    notes : list of str
        Sentences about the whole batch.
    """

    client: Client
    folders: list[FolderState]
    settings: BatchSettings
    emit: Emit
    should_stop: StopCheck
    relay: bool = False
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._batch = uuid.uuid4().hex
        self._answers: queue.SimpleQueue[tuple[FolderState, Future[Any]]] = queue.SimpleQueue()
        self._said: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self._futures: dict[int, Future[Any]] = {}
        self._ready = list(self.folders)
        self._due: list[tuple[float, FolderState]] = []
        self._locks: dict[int, ProjectFolder] = {}
        self._avoided: dict[str, set[str]] = {}
        """Workers that lack what a stage needs, by stage."""
        self._now: dict[int, tuple[str, float]] = {}
        self._started: dict[int, int] = {}
        """Times that the present task of a folder began."""
        self._workers: dict[str, dict[str, float]] = {}
        self._looked_at = self._said_at = float("-inf")
        self._no_worker_since: float | None = None
        self._waits: set[tuple[int, str]] = set()
        """Tasks of which it was said that they wait for a worker."""

    def run(self) -> None:
        """Work until every folder has ended."""
        self.client.subscribe_topic(topic_of(self._batch), lambda event: self._said.put(event[1]))
        try:
            while any(not one.ended for one in self.folders):
                if self.should_stop():
                    self._stop()
                    break
                self._look()
                self._submit()
                self._take_answers(_POLL_SECONDS)
                self._say_progress()
            self._read_messages()
        finally:
            for project in self._locks.values():
                project.__exit__(None, None, None)

    # -- workers ---------------------------------------------------------------------------------------------------

    def _look(self) -> None:
        """Look which workers there are, and give up stages that none of them can do."""
        if time.monotonic() - self._looked_at < _LOOK_SECONDS or self.client.status != "running":
            return
        self._looked_at = time.monotonic()
        with contextlib.suppress(OSError, TimeoutError):
            self._workers = worker_resources(self.client)
        waiting = [one for one in self.folders if not one.ended and not self._fits(one)]
        if not waiting:
            self._no_worker_since = None
        elif self._no_worker_since is None:
            self._no_worker_since = time.monotonic()
        elif time.monotonic() - self._no_worker_since > self.settings.worker_wait:
            for folder in waiting:
                self._fail(folder, self._what_is_missing(folder))
                self._drop(folder)

    def _fits(self, folder: FolderState) -> bool:
        needs = self._needs(folder)
        return any(all(has.get(name, 0) >= amount for name, amount in needs.items()) for has in self._workers.values())

    def _what_is_missing(self, folder: FolderState) -> str:
        most = max((has.get(MEMORY, 0) for has in self._workers.values()), default=0)
        if not self._workers:
            return "No worker is connected to the scheduler. Start workers, then try again."
        if not most:
            return (
                f"No worker has the resource {MEMORY}. Start the workers with "
                f'--resources "{MEMORY}=16e9", the bytes of memory for the engine.'
            )
        need, _ = folder.expected_memory(self.settings.photos_memory)
        gpu = f" and a {GPU}" if folder.stage in self.settings.gpu_stages else ""
        return (
            f"The stage {folder.stage!r} needs {max(need, folder.memory) / 1e9:.1f} GB of memory{gpu}, and the largest "
            f"worker has {most / 1e9:.1f} GB. Use fewer and larger workers, or a smaller preset."
        )

    def _needs(self, folder: FolderState) -> dict[str, float]:
        """Return what the next task of a folder reserves: the high forecast, or a whole worker where that is enough."""
        expected, high = folder.expected_memory(self.settings.photos_memory)
        most = max((has.get(MEMORY, 0) for has in self._workers.values()), default=0)
        memory = max(folder.memory, high)
        if folder.memory <= most and expected <= most < memory:
            memory = int(most)
        needs: dict[str, float] = {MEMORY: memory}
        if folder.stage in self.settings.gpu_stages:
            needs[GPU] = 1
        return needs

    # -- tasks -----------------------------------------------------------------------------------------------------

    def _submit(self) -> None:
        now = time.monotonic()
        due = [one for at, one in self._due if at <= now]
        self._due = [(at, one) for at, one in self._due if at > now]
        self._ready += due
        if self.client.status != "running":
            return
        room = len(self.folders)
        if self.settings.ship:
            room = max(1, _RUNNING_AT_ONCE * len(self._workers)) - len(self._futures)
            if not self._workers:
                return
        # The next stage of an earlier folder goes first, so that scenes are finished one after the other.
        self._ready.sort(key=lambda one: one.number)
        while self._ready and room > 0:
            folder = self._ready.pop(0)
            try:
                self._submit_one(folder)
            except ProjectInUse as error:
                self._wait_for_other_job(folder, str(error))
            except HeritageError as error:
                self._fail(folder, str(error))
            room -= 1

    def _submit_one(self, folder: FolderState) -> None:
        arguments: list[Any] = [
            {
                "version": __version__, "batch": self._batch, "folder": folder.number, "photos": str(folder.photos),
                "out": str(folder.out), "stage": folder.stage, "arguments": list(self.settings.arguments),
                "command": list(folder.command), "relay": self.relay,
                # Helpers need shared folders, and workers of this computer share its cores.
                "scheduler": "" if self.settings.ship else self.settings.scheduler,
            }
        ]  # fmt: skip
        if self.settings.ship:
            bundle = self._bundle(folder)
            # As a future: a large value must not go through the scheduler.
            arguments.append(self.client.scatter([bundle], hash=False)[0])
        avoided = self._avoided.get(folder.stage, set())
        allowed = [address for address in self._workers if address not in avoided]
        future = self.client.submit(
            run_stage, *arguments, key=f"{self._batch}-{folder.number}-{folder.stage}-{uuid.uuid4().hex}",
            resources=self._needs(folder), priority=-folder.number, pure=False,
            # Not strictly: a worker that was started again has another address.
            workers=allowed if avoided and allowed else None, allow_other_workers=bool(avoided and allowed),
        )  # fmt: skip
        folder.state = "running"
        self._futures[folder.number] = future
        self._started[folder.number] = 0
        future.add_done_callback(lambda one: self._answers.put((folder, one)))

    def _bundle(self, folder: FolderState) -> Bundle:
        if folder.number not in self._locks:
            project = ProjectFolder.create(folder.out)
            project.__enter__()
            self._locks[folder.number] = project
        limit = self.settings.max_shipped_bytes
        return {"photos": pack_photos(folder.photos, limit), "project": pack(folder.out, limit)}

    def _drop(self, folder: FolderState) -> None:
        """Forget the task of a folder, and let others work in its project."""
        future = self._futures.pop(folder.number, None)
        if future is not None:
            future.release()
        self._now.pop(folder.number, None)
        if folder.ended:
            self._ready = [one for one in self._ready if one is not folder]
            self._due = [(at, one) for at, one in self._due if one is not folder]
            project = self._locks.pop(folder.number, None)
            if project is not None:
                project.__exit__(None, None, None)

    # -- answers ---------------------------------------------------------------------------------------------------

    def _take_answers(self, seconds: float) -> None:
        with contextlib.suppress(queue.Empty):
            taken = [self._answers.get(timeout=seconds)]
            while not self._answers.empty():
                taken.append(self._answers.get())
            self._read_messages()
            for folder, future in taken:
                # Only the present task of a folder counts.
                if self._futures.get(folder.number) is future and not folder.ended:
                    self._take(folder, future)
                    self._drop(folder)

    def _take(self, folder: FolderState, future: Future[Any]) -> None:
        if future.status == "finished":
            try:
                answer = future.result(timeout=self.settings.scheduler_wait)
            except Exception:  # noqa: BLE001 the worker that held the answer is gone
                answer = None
            if answer is not None:
                self._take_answer(folder, answer)
                return
        if future.status == "error":
            error = future.exception()
            if type(error).__name__ == "KilledWorker":
                self._again(folder, f"The worker died several times in the stage {folder.stage!r}.")
            else:
                self._again(folder, f"The worker failed: {type(error).__name__}: {str(error)[:300]}")
            return
        # Cancelled or lost: the scheduler has forgotten it.
        self._warn_all("The scheduler was lost; what had not ended was given to it again.")
        folder.restarts += 1
        self._ready.append(folder)

    def _take_answer(self, folder: FolderState, answer: dict[str, Any]) -> None:
        outcome, error = answer["outcome"], answer["error"]
        folder.seconds += answer["seconds"]
        folder.cpu_seconds += answer["cpu_seconds"] or 0.0
        if answer["project"] is not None:
            try:
                mirror(answer["project"], folder.out)
                project = ProjectFolder.open_existing(folder.out)
                # On the worker it was a folder of its own.
                project.put("photo_folder", str(folder.photos))
            except HeritageError as problem:
                self._fail(folder, str(problem))
                return
        folder.computed += answer["computed"]
        folder.done = answer["done"] or folder.done
        folder.forecast = answer["forecast"] or folder.forecast
        for sentence in answer["warnings"]:
            folder.note(sentence)
        folder.message, folder.outputs = answer["message"], answer["outputs"]
        if outcome == "done":
            folder.memory, folder.busy_since = 0, None
            folder.advance()
            if not folder.ended:
                self._ready.append(folder)
        elif outcome == "busy":
            self._wait_for_other_job(folder, error)
        elif outcome == "killed":
            need, high = folder.expected_memory(self.settings.photos_memory)
            folder.memory = int(max(folder.memory, high) * self.settings.more_memory)
            most = max((has.get(MEMORY, 0) for has in self._workers.values()), default=0)
            # Where no worker has more, one that does nothing else may do.
            folder.memory = int(min(folder.memory, max(most, need)))
            self._again(folder, f"{error} The stage {folder.stage!r} is tried with {folder.memory / 1e9:.1f} GB.")
        elif outcome == "failed" and answer["error_type"] in WORKER_PROBLEMS:
            self._avoided.setdefault(folder.stage, set()).add(answer["worker"])
            if answer["error_type"] == ModelFileError.__name__:
                self._warn_all(f"The worker {answer['worker']} ({answer['host']}): {error}")
            self._again(folder, error, f" on {answer['worker']} ({answer['host']})", answer["error_type"])
        elif outcome == "stopped":
            # Somebody else stopped the engine on the worker.
            self._again(folder, "The engine was stopped on its worker.")
        else:
            self._fail(folder, error, answer["error_type"])

    def _again(self, folder: FolderState, why: str, where: str = "", error_type: str = "") -> None:
        folder.tries += 1
        if folder.tries >= self.settings.tries:
            self._fail(folder, why, error_type)
            return
        sentence = f"The stage {folder.stage!r} failed{where} and is tried again: {why}"
        if folder.note(sentence):
            self._warn(folder, sentence)
        self._ready.append(folder)

    def _wait_for_other_job(self, folder: FolderState, why: str) -> None:
        now = time.monotonic()
        if folder.busy_since is None:
            folder.busy_since = now
        if now - folder.busy_since > self.settings.busy_limit:
            self._fail(folder, why)
            return
        if folder.note("Another job worked in the project; this batch waited for it and kept what it did."):
            self._warn(folder, f"Another job is working in {folder.out}, which is waited for.")
        self._due.append((now + self.settings.busy_pause, folder))

    def _fail(self, folder: FolderState, why: str, error_type: str = "") -> None:
        folder.state, folder.error, folder.error_type = "failed", why, error_type
        if not self.relay:
            self.emit(Warned(f"{folder.name} failed: {why}"))

    def _warn(self, folder: FolderState, sentence: str) -> None:
        self.emit(Warned(sentence if self.relay else f"{folder.name}: {sentence}"))

    def _warn_all(self, sentence: str) -> None:
        if sentence not in self.notes:
            self.notes.append(sentence)
            self.emit(Warned(sentence))

    # -- progress and end --------------------------------------------------------------------------------------------

    def _read_messages(self) -> None:
        while not self._said.empty():
            said = self._said.get()
            folder = self.folders[said["folder"]]
            if said["kind"] == "event":
                event = from_json_line(said["line"])
                # Each task begins with the stages that are done.
                if event is not None and getattr(event, "stage", "") not in folder.done:
                    self.emit(event)
            elif said["kind"] == "progress":
                self._now[folder.number] = (said["now"], said["fraction"])
            elif said["kind"] == "started" and said["stage"] == folder.stage and folder.number in self._futures:
                self._started[folder.number] += 1
                self._now[folder.number] = (folder.stage, 0.0)
                if self._started[folder.number] > 1:
                    folder.restarts += 1
                    sentence = f"A worker was lost in the stage {folder.stage!r}; another one went on with it."
                    folder.note(sentence)
                    self._warn(folder, sentence)

    def _say_progress(self) -> None:
        self._read_messages()
        if self.relay:
            self._say_waiting()
            return
        if time.monotonic() - self._said_at < _SAY_SECONDS:
            return
        self._said_at = time.monotonic()
        shares = [1.0 if one.ended else one.share_done() for one in self.folders]
        running = [f"{self.folders[n].name}: {stage} {share:.0%}" for n, (stage, share) in sorted(self._now.items())]
        done = sum(one.ended for one in self.folders)
        text = f"{done} of {len(self.folders)} folders" + (f"; {', '.join(running[:4])}" if running else "")
        self.emit(Progress("batch", sum(shares) / len(shares), None, text))

    def _say_waiting(self) -> None:
        """Say once for each task that no worker has begun it."""
        for number in self._futures:
            folder = self.folders[number]
            key = (number, folder.stage)
            if not self._started.get(number) and key not in self._waits:
                self._waits.add(key)
                self.emit(Progress(folder.stage, 0.0, None, "waiting for a free worker"))

    def _stop(self) -> None:
        """Stop the engines at their next safe point, so that nothing that they did is lost, and leave."""
        with contextlib.suppress(OSError, TimeoutError):
            self.client.run(stop_stages, self._batch, on_error="ignore")
        end = time.monotonic() + self.settings.stop_wait
        # A task that began meanwhile ends at once, and others do not begin: the answers are not followed up.
        for number, future in list(self._futures.items()):
            if future.status == "pending" and not self._started.get(number):
                future.cancel()
        while self._futures and time.monotonic() < end:
            self._read_messages()
            for number, future in list(self._futures.items()):
                if future.status != "pending":
                    if future.status == "finished":
                        with contextlib.suppress(Exception):
                            self._take_answer(self.folders[number], future.result(timeout=10))
                    self._futures.pop(number)
            time.sleep(0.1)
        for folder in self.folders:
            if folder.state != "done" and not folder.error:
                folder.state = "stopped"
        self.notes.append("Stopped. Run the same command again to continue.")
