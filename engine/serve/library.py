"""Projects of a user on the server's disk: photos as they were uploaded, the project folder, and its jobs."""

from __future__ import annotations

import os
import re
import secrets
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from ..errors import DiskError, ProjectError
from ..files import delete_derived, is_inner_name, path_within, read_json, write_json
from ..system import name_in_order, replace_file
from .settings import PHOTO_TYPES, ServeSettings

__all__ = ["PROJECT", "Library", "NotFound", "WebProject"]

PROJECT = "project"
_INFO, _HASHES = "info.json", "hashes.json"
_SCHEMA = {"title": str, "created": str}
_ID = re.compile(r"[0-9a-f]{12}")


class NotFound(ProjectError):
    """What a request names does not exist, or belongs to another user: clients must not learn which."""


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

    def rename(self, title: str) -> None:
        """Give it another title."""
        write_json(self.folder / _INFO, {**self._info(), "title": title})

    def photo_names(self) -> list[str]:
        """Return the names of the uploaded photos, sorted."""
        if not self.photos.is_dir():
            return []
        return sorted(
            entry.name
            for entry in os.scandir(self.photos)
            if is_inner_name(entry.name) and entry.is_file() and entry.name.lower().endswith(PHOTO_TYPES)
        )

    def photo(self, name: str) -> Path:
        """Return the file of a photo.

        Raises
        ------
        NotFound
            When there is none of this name.
        """
        if name not in self.photo_names():
            raise NotFound(f"There is no photo {name!r}.")
        return path_within(self.photos, name)

    def video_names(self) -> list[str]:
        """Return the names of the uploaded videos, sorted."""
        if not self.videos.is_dir():
            return []
        return sorted(entry.name for entry in os.scandir(self.videos) if is_inner_name(entry.name) and entry.is_file())

    def video(self, name: str) -> Path:
        """Return the file of a video.

        Raises
        ------
        NotFound
            When there is none of this name.
        """
        if name not in self.video_names():
            raise NotFound(f"There is no video {name!r}.")
        return path_within(self.videos, name)

    def known_hashes(self) -> dict[str, str]:
        """Return the SHA-256 of each photo that is there."""
        file = self.folder / _HASHES
        hashes: dict[str, str] = read_json(file, {str: str}, advice="Delete it.") if file.exists() else {}
        present = set(self.photo_names())
        return {name: sha256 for name, sha256 in hashes.items() if name in present}

    def note_hash(self, name: str, sha256: str) -> None:
        """Store the SHA-256 of a photo."""
        write_json(self.folder / _HASHES, {**self.known_hashes(), name: sha256})

    def _info(self) -> dict[str, str]:
        info: dict[str, str] = read_json(self.folder / _INFO, _SCHEMA, advice="Delete the project.")
        return info


class Library:
    """The projects of one user.

    Parameters
    ----------
    settings : ServeSettings
    user : str
        A name that `Accounts` knows.
    """

    def __init__(self, settings: ServeSettings, user: str) -> None:
        self._settings = settings
        self.folder = settings.data / "users" / user
        self.uploads = self.folder / "uploads"
        self._projects = self.folder / "projects"

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
        project.photos.mkdir(parents=True)
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
        """Move a project to the trash of the user, a folder that only the server's owner empties.

        Raises
        ------
        DiskError
            When it cannot be moved.
        """
        trash = self.folder / "trash"
        try:
            trash.mkdir(exist_ok=True)
            replace_file(project.folder, trash / f"{name_in_order(())}-{project.id}")
        except OSError as error:
            raise DiskError(f"The project could not be deleted: {error.strerror or error}.") from error

    def delete_photo(self, project: WebProject, name: str) -> None:
        """Delete an uploaded photo.

        Raises
        ------
        NotFound
            When there is none of this name.
        """
        project.photo(name)
        delete_derived(project.photos, name)

    def delete_video(self, project: WebProject, name: str) -> None:
        """Delete an uploaded video; the photos that were taken from it stay.

        Raises
        ------
        NotFound
            When there is none of this name.
        """
        project.video(name)
        delete_derived(project.videos, name)

    def used_bytes(self) -> int:
        """Return the size of everything the user has uploaded, unfinished uploads included."""
        folders = [self.uploads]
        for project in self.projects():
            folders += [project.photos, project.videos]
        return sum(
            entry.stat().st_size
            for folder in folders
            if folder.is_dir()
            for entry in os.scandir(folder)
            if entry.is_file()
        )

    def require_space(self, n_bytes: int) -> None:
        """Check that a file of `n_bytes` may be uploaded.

        Raises
        ------
        DiskError
            When the user's share or the disk is full.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        if self.used_bytes() + n_bytes > self._settings.max_user_bytes:
            share = self._settings.max_user_bytes / 1e9
            raise DiskError(f"Your photos would take more than your {share:.0f} GB. Delete projects that are finished.")
        if shutil.disk_usage(self.folder).free - n_bytes < self._settings.min_free_bytes:
            raise DiskError("The disk of the server is full. Ask its owner to make space, then upload again.")
