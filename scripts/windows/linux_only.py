"""Tests that Windows' Python does not run, and why. Everything else of the folders in `GROUPS` has to pass there."""

from __future__ import annotations

GROUPS = {
    "processes": ("tests/engine/core/test_child_process.py", "tests/engine/workers/jobs", "tests/engine/core/system"),
    "files": ("tests/engine/core/files", "tests/engine/project/test_project_folder.py"),
    "structure of photos": ("tests/engine/photos",),
    "installer": ("tests/engine/core/test_certificates.py", "tests/engine/install/environment"),
    "model files": ("tests/engine/install/models",),
    "formats": ("tests/engine/formats", "tests/engine/scene"),
    "records": ("tests/engine/delivery/records", "tests/engine/delivery/packages"),
    "command line": (
        "tests/engine/cli/test_cli.py",
        "tests/engine/core/test_events.py",
        "tests/engine/core/test_settings.py",
    ),
    "computer": ("tests/engine/cli/test_doctor.py", "tests/engine/project/test_provenance.py"),
    "pipeline": ("tests/engine/pipeline/test_pipeline.py",),
    "add-on without Blender": ("tests/addon",),
}
"""Tests by what they are about: files and folders of the repository."""

QUICK = ("processes", "files", "structure of photos", "installer")
"""What ``--quick`` runs."""

BLENDER = "tests/blender/"
"""Folder of the tests that run in Blender as a module."""

IN_BLENDER = {
    "zip": ("test_extension_zip.py", "test_subscription.py"),
    "jobs": (
        "addon/test_job_order.py",
        "addon/test_job_runner.py",
        "addon/test_presets.py",
        "addon/test_scene_question.py",
        "addon/test_set_up.py",
        "addon/test_stopped_jobs.py",
    ),
    "objects": (
        "addon/test_by_hand.py",
        "addon/test_clicking.py",
        "addon/test_meshes.py",
        "addon/test_objects.py",
        "addon/test_placement.py",
        "addon/test_selection.py",
    ),
    "panels": (
        "addon/test_german.py",
        "addon/test_guards.py",
        "addon/test_manners.py",
        "addon/test_measuring.py",
        "addon/test_panels.py",
    ),
    "splats": (
        "addon/test_appended.py",
        "addon/test_display.py",
        "addon/test_first_look.py",
        "addon/test_moved_vertices.py",
        "addon/test_native_splats.py",
        "addon/test_render.py",
        "addon/test_scene_settings.py",
        "addon/test_view_tools.py",
        "addon/test_viewport_shader.py",
    ),
    "files": (
        "addon/test_export.py",
        "addon/test_files_of_others.py",
        "addon/test_hostile_files.py",
        "addon/test_ply_in_and_out.py",
    ),
    "projects": (
        "addon/test_earlier_releases.py",
        "addon/test_hostile_blend.py",
        "addon/test_moved_project.py",
        "addon/test_project.py",
        "addon/test_project_history.py",
    ),
    "from photos to files": ("test_end_to_end.py",),
}
"""Tests that run in Blender as a module, by what they are about: files of `BLENDER`."""

WITH_MODELS = ("from photos to files",)
"""Groups of `IN_BLENDER` that need the model files."""

NOT_ON_WINDOWS: dict[str, str] = {
    "tests/engine/photos/test_bounded.py::test_child_without_enough_memory_rejects_its_photo_only": (
        "the memory of a child process is bounded on Linux only"
    ),
    "tests/engine/delivery/packages/test_hostile_packages.py::test_link_in_a_package_is_refused": (
        "under Wine, a symbolic link is shown as the file that it leads to"
    ),
    "tests/engine/pipeline/test_pipeline.py::test_stop_signal_is_one_sentence_and_the_next_run_continues": (
        "Windows sends no signals; programs are stopped there by a file, as the cancelled reconstruction is"
    ),
    **dict.fromkeys(
        (
            "tests/blender/addon/test_hostile_files.py::"
            f"test_project_that_cannot_be_opened_is_refused_in_a_sentence[{case}]"
            for case in ("cameras are a pipe", "membership is a pipe")
        ),
        "Windows has no pipes among the files of a folder",
    ),
    **dict.fromkeys(
        (
            "tests/blender/addon/test_hostile_files.py::"
            f"test_project_that_cannot_be_opened_is_refused_in_a_sentence[{case}]"
            for case in ("cameras are a link out", "object is a link out", "folder of the object is a link out")
        ),
        "under Wine, a symbolic link is shown as the file that it leads to",
    ),
}
"""Test to the reason why it cannot pass on Windows, or not under Wine."""
