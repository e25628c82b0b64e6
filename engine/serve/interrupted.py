"""Jobs that were stopped together with the server: which of them the next server continues.

A job that ended while a server ran is marked as taken. One that is not, and gave no reason of its own, was ended from
outside: the container was stopped, or the computer was switched off.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path

from ..workers.jobs import Job

_MAX_KILLED = 3
"""A job that was killed this often in a row may be what ends the container, and is left to the user."""


def interrupted_jobs(found: Sequence[tuple[Path, Job]]) -> list[Job]:
    """Return the jobs to continue, in the order in which they were first wanted.

    Parameters
    ----------
    found : sequence of (Path, Job)
        All jobs with the folders of their projects, the oldest of each project first.
    """
    jobs: dict[Path, list[Job]] = {}
    for project, job in found:
        jobs.setdefault(project, []).append(job)
    wanted = []
    for of_project in jobs.values():
        last = of_project[-1]
        if not last.is_taken() and last.was_ended() and _times_killed(of_project) < _MAX_KILLED:
            wanted.append(last)
    return sorted(wanted, key=lambda job: job.folder.name)


def _times_killed(jobs: Sequence[Job]) -> int:
    """Return how often in a row the last of these jobs was killed."""
    same = takewhile(lambda job: job.command == jobs[-1].command, reversed(jobs))
    return sum(1 for _ in takewhile(lambda job: job.was_ended() and not job.poll().error_type, same))
