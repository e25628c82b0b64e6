"""From a few real photos to exported objects, with the operators of the user interface.

The Blender that comes first reconstructs the scene. Another one continues from a copy of it, as after a restart: most
of the time would be the engine's, which is the same for all.
"""

from __future__ import annotations

import json
import os
import shutil
import time
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

VIEWS = (6, 7, 8, 9, 10, 11)


@pytest.fixture
def shared() -> Path:
    """Return a folder that all Blenders of a run share."""
    return Path(os.environ["GAUSSIAN_HERITAGE_SHARED"])


def write_photos(folder: Path) -> None:
    """Write six neighbouring photos of the museum room, and one broken file."""
    source = Path(os.environ["GAUSSIAN_HERITAGE_DEMO"]) / "museum_room" / "photos"
    folder.mkdir()
    for view in VIEWS:
        shutil.copy(source / f"view_{view:02}.jpg", folder)
    (folder / "broken.jpg").write_bytes(b"\xff\xd8\xff\xe0 not a photo")


@pytest.fixture
def project(blender: ModuleType, shared: Path, tmp_path: Path) -> Path:
    """Import the photos with Blender's operator, and return the project."""
    photos, whole, ended = shared / "Fotos für morgen", shared / "project", shared / "ended"
    project = tmp_path / "project"
    try:
        shared.mkdir()
    except FileExistsError:
        while not ended.exists():
            time.sleep(0.1)
        shutil.copytree(whole, project)
    else:
        write_photos(photos)
    try:
        blender.ops.heritage.import_photo_folder(directory=str(photos), project=str(project), preset="preview")
        if not whole.exists():
            shutil.copytree(project, whole)
    finally:
        ended.touch()
    return project


@pytest.mark.slow
def test_photos_become_a_scene_an_object_and_files(blender: ModuleType, project: Path, tmp_path: Path) -> None:
    scene = blender.context.scene
    (splats,) = [obj for obj in scene.objects if obj.heritage.role == "SCENE"]
    assert len(splats.data.vertices) > 200

    stored = json.loads((project / "project.json").read_text(encoding="utf-8"))
    assert stored["stages"]["cameras"]["figures"]["n_registered"] >= 5
    assert [photo["name"] for photo in stored["stages"]["photos"]["figures"]["rejected"]] == ["broken.jpg"]
    assert (project / "report" / "report.html").stat().st_size > 10_000

    blender.ops.heritage.isolate(photo="view_08.jpg", x=330.0, y=400.0, name="teapot")
    (teapot,) = [obj for obj in scene.objects if obj.heritage.role == "OBJECT"]
    assert 0 < len(teapot.data.vertices) < len(splats.data.vertices)
    assert "teapot" in blender.data.collections

    exported = tmp_path / "exported"
    exported.mkdir()
    for file_format in ("PLY", "GLB"):
        blender.ops.heritage.export_objects(directory=str(exported), format=file_format, scope="ALL")
    assert sorted(file.suffix for file in exported.iterdir() if file.stem == "teapot") == [".glb", ".ply"]
    with pytest.raises(RuntimeError, match="teapot"):
        blender.ops.heritage.export_objects(directory=str(exported), format="PLY", scope="ALL")

    with pytest.raises(RuntimeError, match="flux capacitor"):
        blender.ops.heritage.isolate(prompt="flux capacitor")
    centre = np.mean([vertex.co for vertex in teapot.data.vertices], axis=0)
    assert np.isfinite(centre).all()
