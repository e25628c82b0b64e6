"""Quality of meshes beside true ones: ``python -m benchmarks.meshes ROOM ...``.

ROOM is a folder of a generated room: ``photos``, ``truth`` and ``project``, as ``python -m benchmarks.rooms`` makes.
Its true meshes are written to ``truth/meshes.npz`` of ``--work`` by ``demo/random_rooms/make_meshes.py`` first. An
object is what the true masks of the training photos show, so that the figures are those of meshing alone. Nothing is
stored in the project but the exhibits of ``--store``, as objects that other commands export.

example: python -m benchmarks.meshes out/rooms/room_1 out/rooms/room_3 --work out/meshes --doc docs/meshes.md
"""

from __future__ import annotations

import argparse
import json
import pickle
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from scipy.spatial import cKDTree

from engine.cameras import training_pinhole, undistort
from engine.core.errors import HeritageError
from engine.core.events import never_stop
from engine.meshing import mesh_object
from engine.meshing.cleaning import main_parts
from engine.meshing.depth import DepthMap, depth_maps
from engine.meshing.drawing import mesh_depth
from engine.meshing.fusion import fuse
from engine.meshing.settings import MeshSettings
from engine.meshing.surface import extract_surface
from engine.objects import DetailPhotos, DetailResult, Views, detail_object, erode_mask, read_part
from engine.objects.settings import BETTER
from engine.pictures import Scene
from engine.project.folder import ProjectFolder
from engine.project.objects import ObjectRecord, new_id, save_object
from engine.scene import Camera, CameraSet, Gaussians, Mesh, PinholeCamera, read_camera_set
from engine.training import load_gaussians

from .documents import print_table
from .mesh_pictures import draw_mesh, draw_shape
from .places import run_room_script
from .rooms.drawn import drawn_from

_POINTS = 30_000
"""Points of a surface that distances are measured at."""
_NEIGHBOURS = 200_000
"""Points of a surface that distances are measured to: the spacing of 30,000 alone is 0.3 % of the diagonal."""
_NEAR = 0.01
"""Distance within which a point counts as found, as a share of the object's diagonal."""
_FINER = 3
"""Rows and columns of a drawn mesh for each of a photo."""
_MIN_PIXELS = 100
"""Smallest true mask, in pixels, that shows the object to the PSNR."""
_HELD_OUT = 6
"""Without test photos of the scene, each so many-th photo is kept from meshing; the splats were trained on it."""
_PICTURE_SIDE = 260
"""Width and height of one picture of an object, in pixels."""
_PAPER = (0.85, 0.85, 0.85)
"""Colour behind splats and meshes."""
_MARK = (
    "**In sample**: room_1, on which constants of meshing were chosen. **Test** of meshing: the other rooms. Distances "
    "in percent of the diagonal of the true object."
)


@dataclass(frozen=True)
class Row:
    """Figures of one object: its mesh, the one of exact depths, and the plain one."""

    room: str
    name: str
    pixel: float
    chamfer: float
    f_score: float
    exact_chamfer: float
    exact_f_score: float
    plain_chamfer: float
    plain_f_score: float
    psnr: float
    splat_psnr: float
    filled: float
    seconds: float


def main() -> int:
    """Measure all objects of the rooms and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rooms", nargs="+", type=Path, help="folders of rooms")
    parser.add_argument("--work", type=Path, required=True, help="folder for true meshes and measured rows")
    parser.add_argument("--only", nargs="*", help="names of exhibits")
    parser.add_argument("--store", nargs="*", default=(), help="exhibits that become objects of their projects")
    parser.add_argument("--picture", type=Path, help="picture of photos, splats and meshes")
    parser.add_argument("--shown", nargs="*", default=(), metavar="ROOM/NAME", help="exhibits in that picture")
    parser.add_argument("--doc", type=Path, help="document with the marks of the part `meshes`")
    options = parser.parse_args()
    rows: list[Row] = []
    pictures = []
    for room in options.rooms:
        truth = true_meshes(room, options.work)
        cases = _cases(room, truth, options.only)
        rows += measured(cases, truth, options.work)
        for case in cases:
            if case.name in options.store:
                case.store(options.work)
            if f"{room.name}/{case.name}" in options.shown:
                pictures.append(case.picture(options.work))
    if options.picture is not None and pictures:
        Image.fromarray(np.concatenate(pictures)).save(options.picture, quality=85)
    print_table(table(rows), options.doc, "meshes", _MARK)
    return 0


def true_meshes(room: Path, work: Path) -> Mapping[str, np.ndarray]:
    """Return the true meshes of a room, in its own coordinates, made by Blender where they are missing."""
    file = work / room.name / "meshes.npz"
    if not file.exists():
        run_room_script("make_meshes.py", *drawn_from(room), "--out", file)
    with np.load(file) as arrays:
        return dict(arrays)


def _cases(room: Path, truth: Mapping[str, np.ndarray], only: Sequence[str] | None) -> list[Case]:
    """Return the exhibits of a room with a true mesh."""
    project = ProjectFolder.open_existing(room / "project")
    gaussians = load_gaussians(project.path / "gaussians")
    camera_set = read_camera_set(project.path / "cameras")
    photos = replace(DetailPhotos.of(project), folder=room / "photos")
    if not photos.held_out:
        photos = replace(
            photos, held_out=frozenset(camera.photo for camera in camera_set.cameras[_HELD_OUT::_HELD_OUT])
        )
    names = json.loads((room / "truth" / "names.json").read_text(encoding="utf-8"))
    return [
        Case(room, entry["name"], int(identity), gaussians, camera_set, photos)
        for identity, entry in names.items()
        if not entry.get("ignore") and f"{entry['name']}/vertices" in truth and (not only or entry["name"] in only)
    ]


def measured(cases: Sequence[Case], truth: Mapping[str, np.ndarray], work: Path) -> list[Row]:
    """Return the rows of a room. What is measured is kept in `work`, so that a killed run does not measure it again."""
    rows = []
    for case in cases:
        kept = case.kept(work)
        if not kept.exists():
            row = case.row(truth[f"{case.name}/vertices"], truth[f"{case.name}/faces"], work)
            kept.write_bytes(pickle.dumps(row))
        row = pickle.loads(kept.read_bytes())  # noqa: S301 written by this program
        if row is not None:
            rows.append(row)
            sys.stdout.write(f"{row}\n")
    return rows


@dataclass(frozen=True)
class Case:
    """One object of a room."""

    room: Path
    name: str
    identity: int
    gaussians: Gaussians
    camera_set: CameraSet
    photos: DetailPhotos

    @property
    def cameras(self) -> Sequence[Camera]:
        return self.camera_set.cameras

    def kept(self, work: Path, suffix: str = ".pickle") -> Path:
        """Return the file of what was measured or made of the object."""
        return work / self.room.name / f"{self.name}{suffix}"

    def row(self, vertices: np.ndarray, faces: np.ndarray, work: Path) -> Row | None:
        """Return the figures of the object; None where it has no mesh, which is said."""
        plain = Scene(replace(self.gaussians, features=None))
        members = self._members(plain)
        scene, own = self._detailed(members, work)
        world_from_original = np.linalg.inv(self.camera_set.original_from_world)
        true = vertices.astype(np.float64) @ world_from_original[:3, :3].T + world_from_original[:3, 3]
        started = time.process_time()
        try:
            result = mesh_object(scene, own, self.cameras, self.photos, MeshSettings(), should_stop=never_stop)
        except HeritageError as error:
            sys.stdout.write(f"{self.room.name} {self.name}: {error}\n")
            return None
        seconds = time.process_time() - started
        self.kept(work, ".mesh").write_bytes(pickle.dumps(result))
        mesh = result.mesh
        visible = self._visible(true, faces)
        diagonal = float(np.linalg.norm(np.ptp(true, axis=0)))
        ours = distances(mesh.vertices.astype(np.float64), mesh.faces[mesh.seen], true, faces, visible, diagonal)
        maps = depth_maps(scene, own, self._training(), should_stop=never_stop)
        pixel = float(np.median([np.median(one.depth[one.depth > 0]) / one.full.K[0, 0] for one in maps]))
        exact = distances(*_fused(self._exact_maps(maps, true, faces)), true, faces, visible, diagonal)
        of_scene = depth_maps(plain, members, self._training(), should_stop=never_stop)
        centers = distances(*_fused(_plain_maps(plain, members, of_scene)), true, faces, visible, diagonal)
        psnr, splat = self._psnr(mesh, scene.gaussians[np.flatnonzero(own)])
        filled = 100 * result.record["filled_share"]
        figures = (100 * pixel / diagonal, *ours, *exact, *centers, psnr, splat, filled, seconds)
        return Row(self.room.name, self.name, *figures)

    def store(self, work: Path) -> None:
        """Make an object with detail of the exhibit in the room's project."""
        members = self._members(Scene(replace(self.gaussians, features=None)))
        record = ObjectRecord(
            new_id(self.name, ()), self.name, {"text": self.name}, 0.5, 1.0, 1.0, int(members.sum()), len(members)
        )
        detailed = self._detail(members, work).detailed
        save_object(self.room / "project", record, members.astype(np.float32), detailed=detailed)

    def picture(self, work: Path) -> np.ndarray:
        """Return a test photo that shows most of the object, its splats, its mesh without light, and its shape."""
        mesh = pickle.loads(self.kept(work, ".mesh").read_bytes()).mesh  # noqa: S301 written by this program
        scene, own = self._detailed(self._members(Scene(replace(self.gaussians, features=None))), work)
        tests = [camera for camera in self.cameras if camera.photo in self.photos.held_out]
        shown = max(tests, key=lambda camera: int((self._mask(camera) > 0).sum()))
        frame = _close_up(training_pinhole(shown, max_side=480), mesh)
        photo, _ = read_part(self.photos, shown, frame, frame)
        splats = Scene(scene.gaussians[np.flatnonzero(own)]).render(frame, color=True)
        paper = np.array(_PAPER)
        drawn = [
            photo / 255,
            splats.channels + (1 - splats.alpha[..., None]) * paper,
            draw_mesh(mesh, frame, background=_PAPER, finer=_FINER),
            draw_shape(mesh, frame, background=_PAPER),
        ]
        return np.rint(255 * np.clip(np.concatenate(drawn, axis=1), 0, 1)).astype(np.uint8)

    def _detail(self, members: np.ndarray, work: Path) -> DetailResult:
        kept = self.kept(work, ".detail")
        if not kept.exists():
            views = Views(Scene(self.gaussians), self.camera_set, render_side=BETTER.render_side)
            kept.write_bytes(pickle.dumps(detail_object(views, self.photos, members, BETTER, should_stop=never_stop)))
        result: DetailResult = pickle.loads(kept.read_bytes())  # noqa: S301 written by this program
        return result

    def _detailed(self, members: np.ndarray, work: Path) -> tuple[Scene, np.ndarray]:
        """Return the scene with the object in detail, its Gaussians first, and which are the object's."""
        detailed = self._detail(members, work).detailed
        whole = replace(self.gaussians, features=None)
        own = whole[np.flatnonzero(members)] if detailed is None else replace(detailed.gaussians, features=None)
        scene = own.joined(whole[np.flatnonzero(~members)])
        return Scene(scene), np.arange(len(scene)) < len(own)

    def _mask(self, camera: Camera) -> np.ndarray:
        """Return the true mask in a photo."""
        return np.asarray(Image.open(self.room / "truth" / "masks" / f"{Path(camera.photo).stem}.png")) == self.identity

    def _members(self, scene: Scene) -> np.ndarray:
        """Return the Gaussians of which the training photos show more inside of the true masks than outside."""
        votes = np.zeros((len(scene), 2), np.float32)
        for camera in self.cameras:
            if camera.photo in self.photos.held_out:
                continue
            frame = training_pinhole(camera, max_side=480)
            mask = undistort(self._mask(camera).astype(np.float32), camera, frame, interpolation="linear") > 0.5
            votes += scene.votes(frame, np.dstack([mask, ~mask]).astype(np.float32))
        return (votes[:, 0] > votes[:, 1]) & (votes[:, 0] > 0.5)

    def _visible(self, true: np.ndarray, faces: np.ndarray) -> np.ndarray:
        """Return points of the true surface that training photos show, [P, 3], in the world."""
        points, normals = sampled(true, faces)
        seen = np.zeros(len(points), bool)
        for camera in self.cameras:
            if camera.photo in self.photos.held_out:
                continue
            frame = training_pinhole(camera, max_side=480)
            mask = undistort(self._mask(camera).astype(np.float32), camera, frame, interpolation="linear") > 0.5
            depth = mesh_depth(frame.scaled(_FINER), true, faces)
            rows, pixels, depths = frame.project(points)
            x, y = pixels.astype(int).T
            column, row = (_FINER * pixels).astype(int).T
            # Half a pixel: more would count the far side of a thin wall.
            tolerance = depths / (2 * frame.K[0, 0])
            facing = np.abs(((frame.center - points[rows]) * normals[rows]).sum(axis=1)) > 0.1 * depths
            seen[rows[mask[y, x] & (depths < depth[row, column] + tolerance) & facing]] = True
        return points[seen]

    def _exact_maps(self, maps: Sequence[DepthMap], true: np.ndarray, faces: np.ndarray) -> Iterator[DepthMap]:
        """Yield the maps with the depths of the true surface, where the true masks show it."""
        for one in maps:
            mask = undistort(self._mask(one.camera).astype(np.float32), one.camera, one.part, interpolation="linear")
            depth = mesh_depth(one.part, true, faces)
            depth = np.where((mask > 0.5) & np.isfinite(depth), depth, 0).astype(np.float32)
            yield replace(one, depth=depth, spread=np.zeros_like(depth))

    def _training(self) -> list[Camera]:
        return [camera for camera in self.cameras if camera.photo not in self.photos.held_out]

    def _psnr(self, mesh: Mesh, alone: Gaussians) -> tuple[float, float]:
        """Return the PSNR of the mesh and of the Gaussians in the test photos, on the inside of the true masks."""
        errors: list[list[float]] = [[], []]
        splats = Scene(alone)
        for camera in self.cameras:
            if camera.photo not in self.photos.held_out:
                continue
            frame = training_pinhole(camera, max_side=480)
            mask = undistort(self._mask(camera).astype(np.float32), camera, frame, interpolation="linear") > 0.5
            if mask.sum() < _MIN_PIXELS:
                continue
            inside = erode_mask(mask, 2)
            photo, _ = read_part(self.photos, camera, frame, frame)
            gain = self.photos.gain(camera.photo)
            for number, colors in enumerate(
                (draw_mesh(mesh, frame, finer=_FINER), splats.render(frame, color=True).channels)
            ):
                difference = np.clip(colors * gain, 0, 1) - photo / 255
                errors[number] += np.square(difference[inside]).ravel().tolist()
        if not errors[0]:
            return float("nan"), float("nan")
        mesh_psnr, splat_psnr = (float(-10 * np.log10(np.mean(one))) for one in errors)
        return mesh_psnr, splat_psnr


def _close_up(frame: PinholeCamera, mesh: Mesh) -> PinholeCamera:
    """Return the square part of a photo that shows a mesh, `_PICTURE_SIDE` pixels wide."""
    local = mesh.vertices.astype(np.float64) @ frame.viewmat[:3, :3].T + frame.viewmat[:3, 3]
    pixels = local[:, :2] / local[:, 2:] * np.diag(frame.K)[:2] + frame.K[:2, 2]
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    scale = _PICTURE_SIDE / (1.15 * float((high - low).max()))
    K = frame.K.copy()
    K[:2, 2] -= (low + high) / 2
    K[:2] *= scale
    K[:2, 2] += _PICTURE_SIDE / 2
    return replace(frame, K=K, width=_PICTURE_SIDE, height=_PICTURE_SIDE)


def _fused(maps: Iterable[DepthMap]) -> tuple[np.ndarray, np.ndarray]:
    """Return the surface that depths give."""
    vertices, faces, known = extract_surface(fuse(list(maps), should_stop=never_stop))
    faces = faces[known[faces].all(axis=1)]
    return vertices, faces[main_parts(vertices, faces, np.ones(len(faces), bool))]


def _plain_maps(scene: Scene, members: np.ndarray, maps: Sequence[DepthMap]) -> Iterator[DepthMap]:
    """Yield the maps with the mean depth of the centres in place of the depth of the surface."""
    alone = scene.with_gaussians(scene.gaussians[np.flatnonzero(members)])
    for one in maps:
        rendered = alone.render(one.part, channels=alone.depth_of(one.part)[:, None])
        depth = rendered.channels[..., 0] / np.maximum(rendered.alpha, 1e-6)
        yield replace(one, depth=np.where(one.depth > 0, depth, 0).astype(np.float32))


def sampled(vertices: np.ndarray, faces: np.ndarray, n_points: int = _POINTS) -> tuple[np.ndarray, np.ndarray]:
    """Return points of a surface, spread evenly, and the normals there, [P, 3] each."""
    rng = np.random.default_rng(0)
    a, b, c = (vertices[faces[:, k]].astype(np.float64) for k in range(3))
    normals = np.cross(b - a, c - a)
    areas = np.linalg.norm(normals, axis=1)
    chosen = rng.choice(len(faces), n_points, p=areas / areas.sum())
    s, t = rng.random((2, n_points, 1))
    over = s + t > 1
    s, t = np.where(over, 1 - s, s), np.where(over, 1 - t, t)
    points = a[chosen] + s * (b - a)[chosen] + t * (c - a)[chosen]
    return points, normals[chosen] / areas[chosen, None]


def distances(
    vertices: np.ndarray, faces: np.ndarray, true: np.ndarray, true_faces: np.ndarray, visible: np.ndarray, size: float
) -> tuple[float, float]:
    """Return the Chamfer distance and the F-score in percent, between a surface and the visible true one.

    A point of the surface counts by its distance from the whole true surface, a visible true one by that from the
    surface.
    """
    surface, whole = (sampled(*one, _NEIGHBOURS)[0] for one in ((vertices, faces), (true, true_faces)))
    to_true, to_surface = cKDTree(whole).query(surface[:_POINTS])[0] / size, cKDTree(surface).query(visible)[0] / size
    precision, recall = float((to_true < _NEAR).mean()), float((to_surface < _NEAR).mean())
    f_score = 2 * precision * recall / max(precision + recall, 1e-9)
    return 100 * float(to_true.mean() + to_surface.mean()) / 2, 100 * f_score


def table(rows: Sequence[Row]) -> str:
    """Return the rows and the medians of each room as a table."""
    head = (
        "| room | object | pixel, % | Chamfer | exact depths | plain | F-score at 1 % | exact depths | plain "
        "| PSNR, mesh | splats | filled, % | CPU s |"
    )
    lines = [head, "| --- " * 13 + "|"]
    lines += [_line(row.room, row.name, [getattr(row, name) for name in _FIGURES]) for row in rows]
    for room in dict.fromkeys(row.room for row in rows):
        own = [row for row in rows if row.room == room]
        medians = [float(np.nanmedian([getattr(row, name) for row in own])) for name in _FIGURES]
        lines.append(_line(f"**{room}**", f"median of {len(own)}", medians))
    return "\n".join(lines)


_FIGURES = (
    "pixel", "chamfer", "exact_chamfer", "plain_chamfer", "f_score", "exact_f_score", "plain_f_score", "psnr",
    "splat_psnr", "filled", "seconds",
)  # fmt: skip


def _line(room: str, name: str, values: Sequence[Any]) -> str:
    digits = (2, 2, 2, 2, 0, 0, 0, 1, 1, 1, 0)
    shown = [f"{value:.{digit}f}" if np.isfinite(value) else "-" for value, digit in zip(values, digits, strict=True)]
    return f"| {room} | {name} | {' | '.join(shown)} |"


if __name__ == "__main__":
    sys.exit(main())
