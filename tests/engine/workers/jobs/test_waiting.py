"""Waiting jobs are kept in their order, started by one Blender alone, and damaged records are left out."""

from __future__ import annotations

from pathlib import Path

from engine.workers.jobs import WaitingJob


def test_stored_jobs_come_back_in_their_order(tmp_path: Path) -> None:
    stored = [
        WaitingJob.store(tmp_path, "segment", tmp_path / "room", ["python", "-m", "engine", prompt])
        for prompt in ("vase", "bust", "drum")
    ]
    assert WaitingJob.stored(tmp_path) == stored


def test_job_is_taken_once(tmp_path: Path) -> None:
    WaitingJob.store(tmp_path, "segment", tmp_path, ["python"])
    (mine,), (theirs,) = (WaitingJob.stored(tmp_path) for _ in range(2))
    assert mine.take() and not theirs.take()
    assert WaitingJob.stored(tmp_path) == []


def test_files_that_are_no_records_are_left_out_and_kept(tmp_path: Path) -> None:
    (tmp_path / "1.json").write_text("{")
    (tmp_path / "2.json").write_text('{"kind": "segment", "subject": "room", "command": []}')
    (tmp_path / "3.json").mkdir()
    job = WaitingJob.store(tmp_path, "segment", tmp_path, ["python"])
    assert WaitingJob.stored(tmp_path) == [job]
    assert len(list(tmp_path.iterdir())) == 4
