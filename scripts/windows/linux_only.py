"""Tests that Windows' Python does not run, and why. Everything else of the folders in `GROUPS` has to pass there."""

from __future__ import annotations

__all__ = ["BLENDER", "GROUPS", "NOT_ON_WINDOWS", "QUICK"]

GROUPS = {
    "processes": ("tests/engine/test_child_process.py", "tests/engine/workers/jobs", "tests/engine/core/system"),
    "files": ("tests/engine/core/files", "tests/engine/test_project_folder.py"),
    "structure of photos": ("tests/engine/photos",),
    "installer": ("tests/engine/install/environment",),
    "model files": ("tests/engine/install/models",),
    "formats": ("tests/engine/formats", "tests/engine/scene"),
    "records": ("tests/engine/delivery/records", "tests/engine/delivery/packages"),
    "command line": ("tests/engine/test_cli.py", "tests/engine/test_events.py", "tests/engine/test_settings.py"),
    "computer": ("tests/engine/test_doctor.py", "tests/engine/test_provenance.py"),
    "pipeline": ("tests/engine/test_pipeline.py",),
    "add-on without Blender": ("tests/addon",),
}
"""Tests by what they are about: files and folders of the repository."""

QUICK = ("processes", "files", "structure of photos", "installer")
"""What ``--quick`` runs."""

BLENDER = "tests/blender/"
"""Folder of the tests that run in Blender as a module."""

NOT_ON_WINDOWS: dict[str, str] = {
    "tests/engine/photos/test_bounded.py::test_child_without_enough_memory_rejects_its_photo_only": (
        "the memory of a child process is bounded on Linux only"
    ),
    "tests/engine/delivery/packages/test_hostile_packages.py::test_link_in_a_package_is_refused": (
        "under Wine, a symbolic link is shown as the file that it leads to"
    ),
    "tests/engine/test_pipeline.py::test_stop_signal_is_one_sentence_and_the_next_run_continues": (
        "Windows sends no signals; programs are stopped there by a file, as the cancelled reconstruction is"
    ),
}
"""Test to the reason why it cannot pass on Windows, or not under Wine."""
