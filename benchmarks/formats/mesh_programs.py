"""Exported meshes in other programs: three.js and model-viewer in Chromium, Blender, glTF-Validator and trimesh."""

from __future__ import annotations

import functools
import json
import subprocess
import urllib.parse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.mesh_pictures import draw_mesh
from benchmarks.pictures import psnr, read_picture
from benchmarks.places import blender_environments, python_of
from benchmarks.serve.page import chromium
from engine.core.errors import EnvironmentProblem
from engine.core.events import never_stop
from engine.delivery.packages import load_export, mesh_of, write_mesh_export
from engine.formats import FORMATS
from engine.meshing import MeshResult
from engine.meshing.settings import MeshSettings
from engine.project.folder import ProjectFolder
from engine.scene import ExportFrame, Mesh

from .readers import HERE, NODE_MODULES
from .viewers import Framed, Point, camera_at, listed, own_picture, served

_FOV = 35.0
"""Vertical field of view in degrees."""
_DISTANCE = 1.9
"""Distance of the eye from the middle of the object, in its diagonals."""
_LOOKS = ((30.0, 20.0), (270.0, 45.0))
"""Directions from which the object is looked at: azimuth and height in degrees."""
_DRAWN = ("glb", "obj", "usdz")
"""Formats with a texture, which programs draw."""
Picture = NDArray[np.float64]
Row = tuple[str, ...]


@dataclass(frozen=True)
class MeshFiles:
    """An object's exported meshes.

    Attributes
    ----------
    mesh : Mesh
        In the frame of its files, Z up.
    made, closed : MeshResult
        As it is exported, and watertight.
    frame : ExportFrame
    open_files, closed_files : dict of str to Path
        By the names of formats.
    """

    mesh: Mesh
    made: MeshResult
    closed: MeshResult
    frame: ExportFrame
    open_files: dict[str, Path]
    closed_files: dict[str, Path]

    @property
    def drawn(self) -> list[Path]:
        """Files with a texture."""
        return [file for file in self.open_files.values() if file.suffix[1:] in _DRAWN]

    def looks(self) -> list[tuple[Point, Point]]:
        """Return eyes, and the point that they look at."""
        low, high = self.mesh.vertices.min(axis=0).astype(float), self.mesh.vertices.max(axis=0).astype(float)
        middle, distance = (low + high) / 2, _DISTANCE * float(np.linalg.norm(high - low))
        angles = np.radians(_LOOKS)
        directions = [(np.cos(h) * np.cos(a), np.cos(h) * np.sin(a), np.sin(h)) for a, h in angles]
        return [(middle + distance * np.array(one), middle) for one in directions]


def exported_meshes(project: Path, name: str, folder: Path) -> MeshFiles:
    """Export an object as a mesh in each format of meshes, as it is and watertight."""
    opened = ProjectFolder.open_existing(project)
    export = load_export(opened, name)
    made, closed = (
        mesh_of(opened, export, MeshSettings(watertight=watertight), should_stop=never_stop)
        for watertight in (False, True)
    )
    files: list[dict[str, Path]] = []
    for label, one in (("open", made), ("closed", closed)):
        (folder / label).mkdir()
        files.append({})
        for kind in [one for one in FORMATS if one.write_mesh is not None]:
            file = folder / label / f"{kind.name}{kind.suffixes[0]}"
            frame = write_mesh_export(file, export, one, kind.name, frame="upright", in_scene=True)
            files[-1][kind.name] = file
    return MeshFiles(made.mesh.moved(frame.from_world), made, closed, frame, *files)


def drawn_rows(files: MeshFiles) -> tuple[list[Row], list[Picture]]:
    """Return how alike programs draw the textures to our drawing, and the pictures of the GLB from the first side."""
    looks = files.looks()
    ours = [draw_mesh(files.mesh, camera_at(*look, _FOV), finer=2).astype(np.float64) for look in looks]
    rows, pictures = [], [ours[0]]
    programs: dict[str, Callable[[Path, list[tuple[Point, Point]]], list[Picture]]] = {"three.js": _by_three}
    # The oldest and the newest.
    for blender in dict.fromkeys([blender_environments()[0], blender_environments()[-1]]):
        programs[blender.replace("blender-", "Blender ")] = functools.partial(_by_blender, blender)
    for program, draw in programs.items():
        for file in files.drawn:
            shots = draw(file, looks)
            outlines = [_overlap(shot, our) for shot, our in zip(shots, ours, strict=True)]
            alike = ", ".join(f"{psnr(shot, our):.1f}" for shot, our in zip(shots, ours, strict=True))
            rows.append((program, file.suffix[1:].upper(), alike, f"{100 * min(outlines):.1f}"))
            if file.suffix == ".glb":
                pictures.append(shots[0])
    return rows, pictures


def shown_in_model_viewer(files: MeshFiles) -> tuple[float, Framed, Picture]:
    """Return what model-viewer shows of the GLB, with light of its own.

    Returns
    -------
    same : float
        How alike the outline from the first side is to ours, 0 to 1.
    framed : Framed
        In its own framing.
    picture : array of shape [H, W, 3]
        From the first side.

    Raises
    ------
    EnvironmentProblem
        When it draws nothing.
    """
    file, (eye, target), (azimuth, height) = files.open_files["glb-mesh"], files.looks()[0], _LOOKS[0]
    x, y, z = target
    asked = {
        "file": file.name,
        "fov": f"{_FOV:g}",
        # Y is up, and an angle of 0 looks from +Z, which is -Y of the engine's world.
        "orbit": f"{azimuth + 90:g}deg {90 - height:g}deg {np.linalg.norm(eye - target):.9g}m",
        "target": f"{x:.9g}m {z:.9g}m {-y:.9g}m",
    }
    with chromium() as browser, served([file]) as (address, _):
        shot, itself = (
            own_picture(browser, f"{address}/model_viewer.html?{urllib.parse.urlencode(one)}")
            for one in (asked, {"file": file.name})
        )
    ours = draw_mesh(files.mesh, camera_at(eye, target, _FOV), finer=2)
    return _overlap(shot, ours), Framed.of(itself), shot


def check_rows(files: MeshFiles) -> list[Row]:
    """Return what glTF-Validator and trimesh find in the files."""
    import trimesh

    rows: list[Row] = []
    for label, file in (("GLB", files.open_files["glb-mesh"]), ("GLB, watertight", files.closed_files["glb-mesh"])):
        found = _validated(file)
        rows.append((label, "glTF-Validator", f"{found['numErrors']} errors, {found['numWarnings']} warnings"))
    scale = abs(float(np.linalg.det(files.frame.from_world[:3, :3])))
    volume = files.closed.mesh.volume * scale
    for name, file in files.closed_files.items():
        if file.suffix == ".usdz":
            continue
        read = trimesh.load(file, force="mesh")
        # Programs for printing join corners at the same place; a texture needs several of them.
        joined = trimesh.Trimesh(read.vertices, read.faces)
        joined.merge_vertices()
        unit = 1e9 if name == "stl" and files.frame.metres_per_unit is not None else 1.0
        said = [
            "watertight" if joined.is_watertight else "not watertight",
            "wound alike" if joined.is_winding_consistent else "not wound alike",
            "a volume" if joined.is_volume else "no volume",
            f"{100 * (joined.volume / unit / volume - 1):+.2f} % beside ours",
        ]
        rows.append((f"{file.suffix[1:].upper()}, watertight", f"trimesh {trimesh.__version__}", ", ".join(said)))
    return rows


def _overlap(shot: Picture, ours: Picture) -> float:
    """Return the share of pixels, of those that either picture shows the object in, in which both do."""
    first, second = (one.max(axis=2) > 0.02 for one in (shot, ours))
    return float((first & second).sum() / max((first | second).sum(), 1))


def _by_three(file: Path, looks: list[tuple[Point, Point]]) -> list[Picture]:
    beside = [file.with_suffix(end) for end in (".mtl", ".png") if file.suffix == ".obj"]
    shots = []
    with chromium() as browser, served([file, *beside]) as (address, _):
        for look in looks:
            # GLB and OBJ have Y up; the loader of USD turns its files as they say.
            eye, target = (listed(np.array([x, z, -y])) for x, y, z in look)
            asked = {"file": file.name, "eye": eye, "target": target, "fov": f"{_FOV:g}"}
            shots.append(own_picture(browser, f"{address}/three.html?{urllib.parse.urlencode(asked)}"))
    return shots


def _by_blender(name: str, file: Path, looks: list[tuple[Point, Point]]) -> list[Picture]:
    out = file.with_name(f"{name}_{file.stem}.png")
    cameras = json.dumps([{"eye": eye.tolist(), "target": target.tolist(), "fov": _FOV} for eye, target in looks])
    command = [python_of(name), HERE / "in_blender.py", file, cameras, out]
    done = subprocess.run([str(word) for word in command], check=False, capture_output=True, text=True)
    shots = [out.with_stem(f"{out.stem}_{number}") for number in range(len(looks))]
    if not all(shot.is_file() for shot in shots):
        raise EnvironmentProblem(f"{name} did not draw {file.name}: {done.stderr.strip()[-300:]}")
    return [read_picture(shot) for shot in shots]


def _validated(file: Path) -> dict[str, int]:
    script = (
        f"const v = require({json.dumps(str(NODE_MODULES / 'gltf-validator'))});"
        f"v.validateBytes(new Uint8Array(require('fs').readFileSync({json.dumps(str(file))})))"
        ".then(r => console.log(JSON.stringify(r.issues)))"
    )
    done = subprocess.run(["node", "-e", script], capture_output=True, text=True, check=True)
    found: dict[str, int] = json.loads(done.stdout)
    return found
