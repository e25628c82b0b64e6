"""Waiting jobs are kept in their order, started by one Blender alone, and damaged records are left out."""

from __future__ import annotations

from pathlib import Path

import pytest

from engine.core.errors import ProjectError
from engine.workers.jobs import WaitingJob, WaitingJobs


def jobs_in(folder: Path) -> WaitingJobs:
    """Return the queue of a session that starts."""
    jobs = WaitingJobs(lambda: folder)
    jobs.find()
    return jobs


def test_stored_jobs_come_back_in_their_order(tmp_path: Path) -> None:
    jobs = jobs_in(tmp_path)
    stored = [
        jobs.add("segment", tmp_path / "room", ["python", "-m", "engine", prompt])
        for prompt in ("vase", "bust", "drum")
    ]
    assert list(jobs) == list(jobs_in(tmp_path)) == stored


def test_job_is_taken_once(tmp_path: Path) -> None:
    jobs_in(tmp_path).add("segment", tmp_path, ["python"])
    mine, theirs = jobs_in(tmp_path).next(), jobs_in(tmp_path).next()
    assert mine is not None and theirs is not None
    assert mine.take() and not theirs.take()
    assert list(jobs_in(tmp_path)) == []


def test_same_job_waits_once_and_busy_projects_are_passed_over(tmp_path: Path) -> None:
    jobs = jobs_in(tmp_path)
    for subject in ("room", "room", "hall"):
        jobs.add("segment", tmp_path / subject, ["python", str(len(jobs))])
    with pytest.raises(ProjectError, match="The same job is waiting already"):
        jobs.add("segment", tmp_path / "room", ["python", "0"])
    first = jobs.add("segment", tmp_path / "first", ["python"], place=0)
    assert jobs.next() == first
    subjects = [job.subject.name for job in (jobs.next({tmp_path / "room"}), jobs.next(), jobs.next()) if job]
    assert subjects == ["hall", "room", "room"] and jobs.next() is None


def test_files_that_are_no_records_are_left_out_and_kept(tmp_path: Path) -> None:
    (tmp_path / "1.json").write_text("{")
    (tmp_path / "2.json").write_text('{"kind": "segment", "subject": "room", "command": []}')
    (tmp_path / "3.json").mkdir()
    job: WaitingJob = jobs_in(tmp_path).add("segment", tmp_path, ["python"])
    assert list(jobs_in(tmp_path)) == [job]
    assert len(list(tmp_path.iterdir())) == 4
