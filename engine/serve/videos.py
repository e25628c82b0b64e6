"""The uploaded videos of a project: how many photos each gave, and why it gave none."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from ..core.files import bytes_of
from ..workers.jobs import Job
from .library import WebProject

_KIND = "frames"


def frames_arguments(project: WebProject, video: Path, density: float = 1.0) -> list[str]:
    """Return the arguments of the engine that take photos from `video`, which `describe_videos` recognises."""
    return [_KIND, str(video), f"--out={project.photos}", f"--density={density:g}"]


def describe_videos(project: WebProject) -> list[dict[str, Any]]:
    """Return of each video name, size, number of photos, whether taking them was stopped, and why it gave none.

    ``density`` is that of the last job that took photos from it; 0 while there was none.
    """
    names = project.video_names()
    if not names:
        return []
    last = _last_jobs(project)
    photos = project.photo_names()
    described = []
    for name in names:
        video = project.videos / name
        own = re.compile(re.escape(video.stem) + r"_\d{6,}\.jpg")
        n_photos = sum(own.fullmatch(photo) is not None for photo in photos)
        job = last.get(name)
        is_stopped = job is not None and job.was_stopped()
        problem = "" if job is None or is_stopped or job.poll().running else job.poll().error
        described.append(
            {
                "name": name,
                "bytes": bytes_of(video),
                "n_photos": n_photos,
                "density": 0.0 if job is None else _density(job),
                "stopped": is_stopped,
                "problem": problem,
            }
        )
    return described


def _last_jobs(project: WebProject) -> dict[str, Job]:
    """Return the last job that took photos from each video, by the video's name."""
    folder = project.folder / "jobs"
    found: dict[str, Job] = {}
    for one in sorted(folder.iterdir()) if folder.is_dir() else ():
        job = Job.attach(one)
        if job is not None and job.kind == _KIND and _KIND in job.command:
            found[Path(job.command[job.command.index(_KIND) + 1]).name] = job
    return found


def _density(job: Job) -> float:
    stated = [word.partition("=")[2] for word in job.command if word.startswith("--density=")]
    return float(stated[0]) if stated else 1.0
