"""Projects of a user on the server's disk: photos as they were uploaded, the project folder, and its jobs."""

from __future__ import annotations

import os
import re
import secrets
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from ..core.errors import FormatError, ProjectError
from ..core.files import bytes_of, delete_derived, is_inner_name, path_within, read_json, write_json, write_problem
from ..photos.settings import PHOTO_SUFFIXES, VIDEO_SUFFIXES
from ..project.own_words import read_learning
from .settings import ServeSettings
from .small_photos import copies_of
from .trash import Trash, TrashItem
from .writers import only_writer

PROJECT = "project"
_INFO, _HASHES = "info.json", "hashes.json"
_SCHEMA = {"title": str, "created": str}
_ID = re.compile(r"[0-9a-f]{12}")


class NotFound(ProjectError):
    """The thing that a request names does not exist, or belongs to another user: clients must not learn which."""


@dataclass(frozen=True)
class WebProject:
    """A project of a user.

    Attributes
    ----------
    folder : Path
        Its folder on the server, with ``photos/``, ``project/`` (as of `reconstruct`), ``jobs/`` and ``cache/``.
    """

    folder: Path

    @property
    def id(self) -> str:
        """Name of the folder."""
        return self.folder.name

    @property
    def user(self) -> str:
        """Name of the user whose project it is."""
        return self.folder.parent.parent.name

    @property
    def own_words(self) -> Path:
        """File of the user's own vocabulary, which no other user's projects read."""
        return self.folder.parent.parent / "own_words.json"

    def own_words_options(self) -> list[str]:
        """Return the options by which the engine uses these words; none where the user does not want it."""
        return [f"--own-words={self.own_words}"] if read_learning(self.project) else []

    @property
    def photos(self) -> Path:
        """Folder of the uploaded photos."""
        return self.folder / "photos"

    @property
    def videos(self) -> Path:
        """Folder of the uploaded videos."""
        return self.folder / "videos"

    @property
    def project(self) -> Path:
        """The engine's project folder."""
        return self.folder / PROJECT

    @property
    def cache(self) -> Path:
        """Folder of files that can be made again: small photos and exports."""
        return self.folder / "cache"

    @property
    def title(self) -> str:
        """The user's name for it."""
        title: str = self._info()["title"]
        return title

    @property
    def created(self) -> str:
        """Date and time in ISO 8601."""
        created: str = self._info()["created"]
        return created

    @property
    def is_damaged(self) -> bool:
        """Whether its description cannot be read; a new title mends it."""
        return self._info() == self._replacement()

    @property
    def trash(self) -> Trash:
        """Its removed photos and videos."""
        return Trash(self.folder / "trash")

    def rename(self, title: str) -> None:
        """Give it another title."""
        with only_writer(self.folder):
            write_json(self.folder / _INFO, {**self._info(), "title": title})

    def photo_names(self) -> list[str]:
        """Return the names of the uploaded photos, sorted."""
        return _names_in(self.photos, PHOTO_SUFFIXES)

    def video_names(self) -> list[str]:
        """Return the names of the uploaded videos, sorted."""
        return _names_in(self.videos, VIDEO_SUFFIXES)

    def photo(self, name: str) -> Path:
        """Return the file of a photo.

        Raises
        ------
        NotFound
            When there is none of this name.
        """
        return _file_of(self.photos, name, self.photo_names(), "photo")

    def video(self, name: str) -> Path:
        """Return the file of a video.

        Raises
        ------
        NotFound
            When there is none of this name.
        """
        return _file_of(self.videos, name, self.video_names(), "video")

    def known_hashes(self) -> dict[str, str]:
        """Return the SHA-256 of each photo that is there and was uploaded."""
        file = self.folder / _HASHES
        try:
            hashes: dict[str, str] = read_json(file, {str: str}, advice="Delete it.") if file.exists() else {}
        except FormatError:
            # It only tells which photos came twice.
            return {}
        present = set(self.photo_names())
        return {name: sha256 for name, sha256 in hashes.items() if name in present}

    def note_hash(self, name: str, sha256: str) -> None:
        """Store the SHA-256 of a photo."""
        with only_writer(self.folder):
            write_json(self.folder / _HASHES, {**self.known_hashes(), name: sha256})

    def remove(self, name: str) -> TrashItem:
        """Move an uploaded photo or video to the trash of the project.

        Raises
        ------
        NotFound
            When there is none of this name.
        DiskError
            When it cannot be moved.
        """
        with only_writer(self.folder):
            folder = self.photos if name in self.photo_names() else self.videos
            if folder == self.videos and name not in self.video_names():
                raise NotFound(f"There is no photo or video {name!r}.")
            item = self.trash.take(path_within(folder, name))
            self._forget_copies(name)
            return item

    def restore(self, item_id: str) -> str:
        """Move a removed photo or video back, and return its name; a number is added where the name is in use.

        Raises
        ------
        NotFound
            When the trash has nothing of this id.
        DiskError
            When it cannot be moved.
        """
        with only_writer(self.folder):
            item = self.trash.find(item_id)
            if item is None:
                raise NotFound("That is not in the trash any more.")
            is_video = item.name.lower().endswith(VIDEO_SUFFIXES)
            folder = self.videos if is_video else self.photos
            name = free_name(item.name, self.video_names() if is_video else self.photo_names())
            self.trash.give_back(item, folder / name)
            self._forget_copies(name)
            return name

    def _forget_copies(self, name: str) -> None:
        """Delete what was made from a photo: another one may get its name."""
        for copy in copies_of(name):
            delete_derived(self.cache, copy)

    def _info(self) -> dict[str, str]:
        try:
            info: dict[str, str] = read_json(self.folder / _INFO, _SCHEMA, advice="Delete the project.")
        except FormatError:
            return self._replacement()
        return info

    def _replacement(self) -> dict[str, str]:
        """Return what stands for a damaged description, so that the project can be seen, renamed and deleted."""
        changed = datetime.fromtimestamp(self.folder.stat().st_mtime, UTC)
        return {"title": f"Damaged project {self.id}", "created": changed.isoformat(timespec="seconds")}


def _file_of(folder: Path, name: str, present: list[str], kind: str) -> Path:
    if name not in present:
        raise NotFound(f"There is no {kind} {name!r}.")
    return path_within(folder, name)


def _names_in(folder: Path, suffixes: tuple[str, ...]) -> list[str]:
    if not folder.is_dir():
        return []
    return sorted(
        entry.name
        for entry in os.scandir(folder)
        if is_inner_name(entry.name) and entry.is_file() and entry.name.lower().endswith(suffixes)
    )


def free_name(name: str, present: list[str]) -> str:
    """Return `name`, with a number where one of `present` has it already, in whatever case."""
    stem, suffix = os.path.splitext(name)
    taken = {one.casefold() for one in present}
    number = 2
    while name.casefold() in taken:
        name, number = f"{stem} {number}{suffix}", number + 1
    return name


class Library:
    """The projects of one user.

    Parameters
    ----------
    user : str
        A name that `Accounts` knows.
    """

    def __init__(self, settings: ServeSettings, user: str) -> None:
        self._settings = settings
        self.folder = settings.data / "users" / user
        self.uploads = self.folder / "uploads"
        self._projects = self.folder / "projects"
        self.trash = Trash(self.folder / "trash")

    def create(self, title: str) -> WebProject:
        """Create an empty project.

        Raises
        ------
        ProjectError
            When the user has too many.
        DiskError
            When it cannot be written.
        """
        if sum(1 for _ in self.projects()) >= self._settings.max_projects:
            raise ProjectError(f"You have {self._settings.max_projects} projects, which is the limit. Delete one.")
        project = WebProject(self._projects / secrets.token_hex(6))
        created = datetime.now(UTC).isoformat(timespec="seconds")
        try:
            project.photos.mkdir(parents=True)
        except OSError as error:
            raise write_problem(project.folder, error) from error
        write_json(project.folder / _INFO, {"title": title, "created": created})
        return project

    def projects(self) -> Iterator[WebProject]:
        """Yield all projects."""
        if self._projects.is_dir():
            for name in sorted(os.listdir(self._projects)):
                if _ID.fullmatch(name) and (self._projects / name / _INFO).is_file():
                    yield WebProject(self._projects / name)

    def project(self, project_id: str) -> WebProject:
        """Return a project.

        Raises
        ------
        NotFound
            When the user has none of this id.
        """
        project = WebProject(self._projects / project_id)
        if not _ID.fullmatch(project_id) or not (project.folder / _INFO).is_file():
            raise NotFound("There is no such project.")
        return project

    def discard(self, project: WebProject) -> None:
        """Move a project to the trash of the user.

        Raises
        ------
        DiskError
            When it cannot be moved.
        """
        with only_writer(project.folder):
            self.trash.take(project.folder)

    def deleted_projects(self) -> list[tuple[TrashItem, WebProject]]:
        """Return what is in the trash of the user, the newest first."""
        return [(item, WebProject(item.path)) for item in self.trash.items() if _ID.fullmatch(item.name)]

    def restore(self, item_id: str) -> WebProject:
        """Move a project from the trash back.

        Raises
        ------
        NotFound
            When the trash has nothing of this id.
        DiskError
            When it cannot be moved.
        """
        item = self.trash.find(item_id)
        if item is None or not _ID.fullmatch(item.name):
            raise NotFound("That is not in the trash any more.")
        project = WebProject(self._projects / item.name)
        with only_writer(project.folder):
            self.trash.give_back(item, project.folder)
        return project

    def empty_trash(self) -> None:
        """Delete everything in the user's trash, and in those of the user's projects."""
        self.trash.empty()
        for project in self.projects():
            with only_writer(project.folder):
                project.trash.empty()

    def used_bytes(self) -> int:
        """Return the size of all uploaded files and of the trash, without unfinished uploads."""
        projects = list(self.projects())
        trash = self.trash.used_bytes() + sum(project.trash.used_bytes() for project in projects)
        return trash + sum(bytes_of(folder) for project in projects for folder in (project.photos, project.videos))
