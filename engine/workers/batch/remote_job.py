"""One command of the engine on the workers of a cluster, as if it ran here: the jobs of a server use it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ...core import errors
from ...core.errors import Cancelled, HeritageError
from ...core.events import Emit, Finished, StopCheck
from ...pipeline.stages import STAGES
from ...project.folder import PROJECT_FILE, ProjectFolder
from .cluster import connected_client
from .coordinator import Coordinator
from .folder_state import FolderState
from .settings import BatchSettings
from .stage_task import stored_forecast

_STAGE_OF = {"frames": "photos", "segment": "objects"}
"""The stage whose forecast says how much memory a command takes."""


def run_remote_job(
    command: Sequence[str], project: Path, settings: BatchSettings, *, emit: Emit, should_stop: StopCheck
) -> None:
    """Run a command of the engine on workers that share the folders, and emit its events.

    ``reconstruct`` is one task a stage, any other command is one task. What a lost worker had begun is done by another.

    Parameters
    ----------
    command : sequence of str
        Name of a command and its arguments, with absolute paths.
    project : Path
        The project folder that it works on; of ``frames``, the folder for the photos.
    settings : BatchSettings
        Its scheduler, and what is tried again.
    emit, should_stop
        See `engine.core.events`.

    Raises
    ------
    HeritageError
        What the engine on the worker said, as the same type.
    Cancelled
        When `should_stop` returned True.
    EnvironmentProblem
        When the scheduler does not answer.
    """
    stages = STAGES if command[0] == "reconstruct" else (_STAGE_OF.get(command[0], "report"),)
    job = FolderState(0, photos=project, out=project, command=tuple(command), stages=stages, stage=stages[0])
    if stages is not STAGES and (project / PROJECT_FILE).is_file():
        job.forecast = stored_forecast(ProjectFolder.open_existing(project))
    with connected_client(settings) as client:
        Coordinator(client, [job], settings, emit, should_stop, relay=True).run()
    if job.state == "stopped":
        raise Cancelled("Stopped. Run the same command again to continue.")
    if job.state == "failed":
        kind = getattr(errors, job.error_type, HeritageError) if job.error_type in errors.__all__ else HeritageError
        raise kind(job.error)
    emit(Finished(job.message, job.outputs))
