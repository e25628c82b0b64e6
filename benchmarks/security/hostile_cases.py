"""Hostile projects: each case changes a finished project as somebody with bad intent would."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from tests.engine.finished_project import N_GAUSSIANS, write_finished_project

PHOTO = "view_08.jpg"


@dataclass(frozen=True)
class Sandbox:
    """A curator's folder: the project that was sent, what must not change, and where writing is allowed.

    Attributes
    ----------
    root : Path
    embeddings : Path or None
        Folder with embeddings of Segment Anything for the photos, so that each command need not compute them again.
    """

    root: Path
    embeddings: Path | None = None

    @property
    def project(self) -> Path:
        """The project that was sent."""
        return self.root / "sent" / "project"

    @property
    def photos(self) -> Path:
        """Its photos, which lie beside it."""
        return self.root / "sent" / "photos"

    @property
    def precious(self) -> Path:
        """The curator's own files: another project, notes, an empty folder."""
        return self.root / "precious"

    @property
    def exports(self) -> Path:
        """Where exported files are written on request."""
        return self.root / "exports"

    @property
    def user(self) -> Path:
        """The user's caches and temporary files."""
        return self.root / "user"

    @property
    def writable(self) -> list[Path]:
        """Folders that may change, with all links followed."""
        return [folder.resolve() for folder in (self.project, self.exports, self.user)]

    def make(self, case: Case) -> None:
        """Make everything anew, and the project hostile."""
        shutil.rmtree(self.root, ignore_errors=True)
        write_finished_project(self.root / "sent", recorded=False)
        shutil.copytree(self.project, self.precious / "project")
        shutil.copytree(self.project / "objects" / "teapot", self.precious / "objects" / "vase")
        (self.precious / "empty").mkdir()
        (self.precious / "notes.txt").write_text("not to be lost", encoding="utf-8")
        Image.new("L", (256, 192), 255).save(self.precious / "x.jpg")
        for folder in (self.exports, self.user):
            folder.mkdir()
        if self.embeddings is not None:
            shutil.copytree(self.embeddings, self.project / "masks", dirs_exist_ok=True)
        self._add_candidate()
        self._add_trash()
        case.change(self)

    def _add_candidate(self) -> None:
        """Store a refused text with one candidate, as the engine does."""
        folder = self.project / "objects" / "_candidates"
        folder.mkdir()
        mask = np.zeros((192, 256), np.uint8)
        mask[100:150, 80:140] = 255
        Image.fromarray(mask).save(folder / "1.png")
        candidate = {"number": 1, "text": "urn", "score": 0.3, "photo": PHOTO, "x": 100.5, "y": 120.5}
        candidate |= {"box": [80.0, 100.0, 140.0, 150.0], "n_gaussians": 9, "picture": "objects/_candidates/1.png"}
        candidate |= {"detector": "offline-vocabulary", "n_scene_gaussians": N_GAUSSIANS}
        np.save(folder / "1.npy", np.packbits(np.arange(N_GAUSSIANS) < 9))
        refused = [{"text": "urn", "message": "Nothing looks enough like 'urn'."}]
        data = {"version": 1, "created": "2026-11-23T00:00:00+00:00", "refused": refused, "candidates": [candidate]}
        (self.project / "objects" / "candidates.json").write_text(json.dumps(data), encoding="utf-8")

    def _add_trash(self) -> None:
        """Store an object that was deleted, as the engine does."""
        entry = self.project / "trash" / "20261123-000000-lid"
        shutil.copytree(self.project / "objects" / "box", entry / "object")
        info = {"version": 1, "id": "lid", "name": "lid", "deleted": "2026-11-23T00:00:00+00:00", "why": "deleted"}
        (entry / "trash.json").write_text(json.dumps({**info, "scene": None}), encoding="utf-8")

    def edit(self, file: str, change: Callable[[Any], object]) -> None:
        """Change a JSON file of the project."""
        path = self.project / file
        data = json.loads(path.read_text(encoding="utf-8"))
        change(data)
        path.write_text(json.dumps(data), encoding="utf-8")

    def link(self, name: str, target: Path | str, *, keep_content: bool = False) -> None:
        """Put a link to `target` in place of a file or folder; with `keep_content`, after moving it to the target."""
        place = self.project / name
        place.parent.mkdir(parents=True, exist_ok=True)
        if keep_content and place.exists():
            shutil.move(place, target)
        elif place.is_dir():
            shutil.rmtree(place)
        elif place.exists():
            place.unlink()
        place.symlink_to(target)


@dataclass(frozen=True)
class Case:
    """One hostile project.

    Attributes
    ----------
    name : str
        What is wrong with it.
    change : callable
        Makes a sandbox's project hostile.
    photo : str
        Name of the photo that is clicked on and rendered.
    commands : tuple of str
        Further commands, beside those that every project goes through.
    is_package : bool
        Whether a package is hostile (`hostile_packages`); it goes through `verify` alone.
    """

    name: str
    change: Callable[[Sandbox], object]
    photo: str = PHOTO
    commands: tuple[str, ...] = ()
    is_package: bool = False


def _object_id(value: object) -> Case:
    def change(sandbox: Sandbox) -> None:
        # An object of the kind "background" is replaced by `segment --complement`.
        sandbox.edit("objects/box/object.json", lambda data: data.update(id=value, prompt={"kind": "background"}))

    return Case(f"id in object.json: {_shown(value)}", change)


def _object_folder(name: str) -> Case:
    def change(sandbox: Sandbox) -> None:
        objects = sandbox.project / "objects"
        (objects / "box").rename(objects / name)
        sandbox.edit(f"objects/{name}/object.json", lambda data: data.update(id=name, prompt={"kind": "background"}))

    return Case(f"folder of an object: {_shown(name)}", change)


def _object_name(value: str) -> Case:
    def change(sandbox: Sandbox) -> None:
        sandbox.edit("objects/box/object.json", lambda data: data.update(name=value))

    return Case(f"name of an object: {_shown(value)}", change, commands=(f"export-object {value}",))


def _photo_name(value: str) -> Case:
    def change(sandbox: Sandbox) -> None:
        sandbox.edit("cameras/cameras.json", lambda data: data["cameras"][2].update(photo=value))
        sandbox.edit("photos/photos.json", lambda data: data["photos"][2].update(name=value))

    return Case(f"photo in cameras.json and photos.json: {_shown(value)}", change, photo=value)


def _candidate(**values: Any) -> Case:
    def change(sandbox: Sandbox) -> None:
        sandbox.edit("objects/candidates.json", lambda data: data["candidates"][0].update(values))

    return Case(f"candidate: {_shown(values)}", change)


def _link(name: str, target: str, *, keep_content: bool = False) -> Case:
    def change(sandbox: Sandbox) -> None:
        place = sandbox.precious / target.removeprefix("precious/") if target.startswith("precious/") else Path(target)
        sandbox.link(name, place, keep_content=keep_content)

    return Case(f"link: {name} -> {target}", change)


def _edit(name: str, file: str, change: Callable[[Any], object], commands: tuple[str, ...] = ()) -> Case:
    return Case(name, lambda sandbox: sandbox.edit(file, change), commands=commands)


def _shown(value: object) -> str:
    text = ascii(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _photo_folder(sandbox: Sandbox) -> None:
    sandbox.edit("project.json", lambda data: data.update(photo_folder=str(sandbox.precious)))
    sandbox.edit("photos/photos.json", lambda data: data.update(folder=str(sandbox.precious)))


def _photo_folder_is_project(sandbox: Sandbox) -> None:
    sandbox.edit("project.json", lambda data: data.update(photo_folder=str(sandbox.project)))
    sandbox.edit("photos/photos.json", lambda data: data.update(folder=str(sandbox.project)))


def _photo_mask(sandbox: Sandbox) -> None:
    mask = str(sandbox.precious / "x.jpg")
    sandbox.edit("photos/photos.json", lambda data: data["photos"][2].update(mask=mask, mask_sha256="0" * 64))


def _hard_link(name: str) -> Case:
    def change(sandbox: Sandbox) -> None:
        place = sandbox.project / name
        place.unlink(missing_ok=True)
        os.link(sandbox.precious / "notes.txt", place)

    return Case(f"hard link: {name} -> a file of the curator", change)


def _transforms(**values: Any) -> Case:
    def change(sandbox: Sandbox) -> None:
        file = sandbox.root / "sent" / "transforms.json"
        data = json.loads(file.read_text(encoding="utf-8"))
        data.update({key: value for key, value in values.items() if key != "file_path"})
        if "file_path" in values:
            data["frames"][0]["file_path"] = values["file_path"]
        file.write_text(json.dumps(data), encoding="utf-8")

    return Case(f"transforms.json: {_shown(values)}", change)


def _zip_member(sandbox: Sandbox) -> None:
    """An NPZ file is a zip archive: one with members whose names lead out."""
    file = sandbox.project / "cameras" / "points.npz"
    with np.load(file) as stored:
        arrays = {name: stored[name] for name in stored.files}
    arrays |= {"../../../precious/notes.txt": np.zeros(3), "/etc/x": np.zeros(3)}
    np.savez(file, allow_pickle=False, **arrays)


def _leftovers(sandbox: Sandbox) -> None:
    """Files under a temporary name are deleted at the next start: as links, and as a folder with a link inside."""
    folder = sandbox.project / ".writing-folder"
    folder.mkdir()
    (folder / "inside").symlink_to(sandbox.project / "objects")
    (sandbox.project / ".writing-dangling").symlink_to(sandbox.project / "nothing")
    (sandbox.project / "objects" / ".writing-objects").symlink_to(sandbox.project / "objects")


def _no_gaussians(sandbox: Sandbox) -> None:
    """A scene whose list is empty."""
    file = sandbox.project / "gaussians" / "scene.ply"
    head, end, _ = file.read_bytes().partition(b"end_header\n")
    file.write_bytes(re.sub(rb"element vertex \d+", b"element vertex 0", head) + end)


def _truncated_scene(sandbox: Sandbox) -> None:
    file = sandbox.project / "gaussians" / "scene.ply"
    file.write_bytes(file.read_bytes()[:-1000])


def _empty_object(sandbox: Sandbox) -> None:
    """An object to which no Gaussian belongs."""
    file = sandbox.project / "objects" / "box" / "membership.npy"
    np.save(file, np.zeros_like(np.load(file)))


def _same_but_case(sandbox: Sandbox) -> None:
    objects = sandbox.project / "objects"
    shutil.copytree(objects / "box", objects / "BOX")
    shutil.copytree(objects / "box", objects / "background")


def _trash(**values: Any) -> Case:
    def change(sandbox: Sandbox) -> None:
        file = "trash/20261123-000000-lid/trash.json"
        sandbox.edit(file, lambda data: data.update(values))

    return Case(f"entry of the trash: {_shown(values)}", change)


def _trash_links(sandbox: Sandbox) -> None:
    """Links in the trash that stay inside of the project, to what emptying it would delete."""
    entry = sandbox.project / "trash" / "20261123-000000-links"
    entry.mkdir()
    (entry / "object").symlink_to(sandbox.project / "objects" / "teapot")
    (sandbox.project / "trash" / "objects").symlink_to(sandbox.project / "objects")


def _complete_sets(sandbox: Sandbox) -> None:
    """Files that a killed run is said to have begun to replace."""
    for folder in (sandbox.project, sandbox.project / "objects", sandbox.project / "objects" / "box"):
        (folder / ".complete-set").mkdir()
        for name in ("objects", "object.json", "..."):
            (folder / ".complete-set" / name).write_text("{}", encoding="utf-8")
    (sandbox.project / "masks" / ".complete-set").symlink_to(sandbox.project / "objects")


def _recorded_files(data: Any) -> None:
    record = {"bytes": 1, "size": 1, "sha256": "0" * 64}
    data.update(files={"../../../../precious/notes.txt": record, "membership.npy": record})


def _stage_outputs(data: Any) -> None:
    for stage in data["stages"].values():
        stage["outputs"] = {"../../precious/notes.txt": {"bytes": 1, "size": 1, "sha256": "0" * 64}}


_FOUND = {"key": "0" * 64, "found": {"jug": ["../../../precious/objects/vase", "/", "..", "teapot"]}}

HONEST = Case("an honest project", lambda sandbox: None)
CASES: tuple[Case, ...] = (
    *(
        _object_id(value)
        for value in (
            "../../../precious/objects/vase", "../..", "..", "/", "/tmp", "C:\\Windows", "\\\\server\\share\\x", "a\0b",
            "", "CON", "\uff0e\uff0e\uff0f\uff0e\uff0e", 3, None, "x" * 10_000,
        )
    ),
    *(_object_folder(name) for name in ("..\\..\\precious", "CON", "...", "box\nx", "\u2025")),
    *(_object_name(value) for value in ("../../precious/notes", "/x", "a\nend_header")),
    *(_photo_name(value) for value in ("../../precious/x.jpg", "/x.jpg", "..\\..\\x.jpg", "C:x.jpg", "a\0.jpg", "")),
    _candidate(picture="/etc/hostname", photo="../../precious/x.jpg"),
    _candidate(number="../../../../precious/x", picture="../../precious/x.jpg"),
    _candidate(number=10**40, score=1e308, text="../../precious/x"),
    _link("objects", "precious/target", keep_content=True),
    _link("objects/box", "precious/target", keep_content=True),
    _link("objects/_candidates", "precious/objects"),
    _link("objects/candidates.json", "precious/target", keep_content=True),
    _link("objects/box/record.json", "precious/new.json"),
    _link("masks", "precious/target", keep_content=True),
    _link("gaussians/scene.ply", "precious/target", keep_content=True),
    _link("checkpoints", "precious/project/objects"),
    _link("report", "precious/empty"),
    _link("trash", "precious/objects"),
    _link("groups", "precious/empty"),
    _link("cameras/sfm-000000000000", "precious/project"),
    _link("lock", "precious/notes.txt"),
    _link("log.jsonl", "precious/notes.txt"),
    _link("log.jsonl", "precious/dangling.txt"),
    _link("project.json", "precious/target", keep_content=True),
    _link(".writing-link", "precious/project"),
    _link("objects/loop", "loop"),
    _link("objects/parent", "../.."),
    _hard_link("log.jsonl"),
    _hard_link("lock"),
    Case("temporary files that are links and folders", _leftovers),
    Case("photo folder of the project: the curator's files", _photo_folder),
    Case("photo folder of the project: the project itself", _photo_folder_is_project),
    Case("mask of a photo: an absolute path", _photo_mask),
    Case("members of points.npz that lead out", _zip_member),
    Case("objects whose ids differ in case only", _same_but_case),
    Case("scene without Gaussians", _no_gaussians),
    Case("truncated scene", _truncated_scene),
    Case("object without Gaussians", _empty_object),
    _trash(id="../../../precious/objects/vase", name="../../precious/x", deleted="0001-01-01T00:00:00+00:00"),
    _trash(id="/", name="", deleted="9999-12-31T23:59:59-12:00", scene="../x"),
    Case("links in the trash", _trash_links),
    Case("complete sets of files that replace others", _complete_sets),
    _transforms(file_path="../../precious/x.jpg"),
    _transforms(ply_file_path="../precious/project/gaussians/scene.ply"),
    _edit("recorded files of an object that lead out", "objects/box/object.json", _recorded_files),
    _edit("recorded outputs of stages that lead out", "project.json", _stage_outputs),
    _edit("key of a training that is said to go on, which leads out", "project.json",
          lambda data: data.update(begun=["training", "../../precious/project"]), ("ask",)),
    _edit("ids in objects_by_prompt that lead out", "project.json", lambda data: data.update(objects_by_prompt=_FOUND),
          ("reconstruct-with-prompts",)),
    _edit("numbers out of all bounds", "objects/box/object.json",
          lambda data: data.update(level=10**15, threshold=1e308, n_gaussians=-1, levels=[{"n_gaussians": 9}] * 99)),
    _edit("planned photos that lead out", "project.json",
          lambda data: data["plan"].update(mask_photos=["../../precious/x.jpg"], held_out=["/x.jpg"])),
)  # fmt: skip
