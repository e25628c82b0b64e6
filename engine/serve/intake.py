"""Complete uploads: a file is checked by its content, and becomes a photo of its project or is refused."""

from __future__ import annotations

import os
import re
import unicodedata
from collections.abc import Iterable
from pathlib import Path

from ..core.errors import DiskError, FormatError, HeritageError, PhotoError, ProjectError
from ..core.files import delete_derived, file_sha256, problem_of_inner_name, write_problem
from ..core.system import replace_file
from ..photos import SUFFIXES, VIDEO, kind_of_file, live_photo_of
from ..photos.settings import PHOTO_SUFFIXES, VIDEO_SUFFIXES
from .library import NotFound, WebProject, free_name
from .settings import ServeSettings
from .small_photos import copies_of, write_small_photo
from .writers import only_writer

_MAX_NAME = 120
"""Bytes of a stored name, so that the files that are named after it have room for their suffixes."""
_UNSAFE = re.compile(r"[^\w.() -]+")


def photo_name(filename: str) -> str:
    """Return the name under which an uploaded file is stored: its last part, without characters that harm.

    Raises
    ------
    FormatError
        When it has no suffix of a photo.
    """
    last = re.split(r"[/\\]", unicodedata.normalize("NFC", filename))[-1]
    stem, suffix = os.path.splitext(_UNSAFE.sub("_", last).strip(" ."))
    if suffix.lower() not in (*PHOTO_SUFFIXES, *VIDEO_SUFFIXES):
        raise FormatError(
            f"{last[:_MAX_NAME]!r} is not a photo or video. Upload JPEG, PNG, TIFF, WebP, HEIC, MP4 or MOV files."
        )
    start = stem.encode("utf-8", "ignore")[: _MAX_NAME - len(suffix)].decode("utf-8", "ignore")
    name = f"{start.strip(' .') or 'photo'}{suffix}"
    problem = problem_of_inner_name(name)
    if problem is not None:
        raise FormatError(f"{last[:_MAX_NAME]!r} {problem}. Rename it and upload it again.")
    return name


def is_video(upload: Path, filename: str) -> bool:
    """Return whether a complete upload is a video by its content, or by its name where its content is unknown."""
    kind = kind_of_file(upload)
    return kind == VIDEO or (kind is None and is_video_name(filename))


def _name_of_kind(filename: str, upload: Path, suffixes: Iterable[str]) -> str:
    """Return the name to store an upload under; a suffix that is none of `suffixes` becomes that of its content."""
    name = photo_name(filename)
    stem, suffix = os.path.splitext(name)
    return name if suffix.lower() in suffixes else stem + SUFFIXES.get(kind_of_file(upload) or "", suffix)


def take_in_photo(project: WebProject, upload: Path, filename: str, sha256: str, settings: ServeSettings) -> str:
    """Check the complete file `upload`, move it to the photos of `project`, and return its name there.

    Parameters
    ----------
    upload : Path
        On the same disk as the project. Stays where it is when this fails, so that it can be tried again.
    filename : str
        As the client named it.
    sha256 : str
        Of `upload`.

    Raises
    ------
    PhotoError
        When it is no picture that can be read.
    ProjectError
        When the project has this photo already, or too many.
    DiskError
        When it cannot be stored.
    """
    name = _name_of_kind(filename, upload, PHOTO_SUFFIXES)
    _require_new(project, name, sha256, settings)
    small = project.cache / f"checked-{upload.name}.jpg"
    try:
        # Outside of the lock: it takes long.
        write_small_photo(upload, small)
    except DiskError:
        raise
    except HeritageError as error:
        raise PhotoError(str(error).replace(str(upload), name).replace(upload.name, name)) from error
    with only_writer(project.folder):
        try:
            _require_new(project, name, sha256, settings)
            name = free_name(name, _taken_names(project.photos))
            replace_file(small, project.cache / copies_of(name)[0])
            replace_file(upload, project.photos / name)
        except OSError as error:
            raise write_problem(project.photos / name, error) from error
        finally:
            delete_derived(project.cache, small.name)
        project.note_hash(name, sha256)
    return name


def _require_new(project: WebProject, name: str, sha256: str, settings: ServeSettings) -> None:
    """Check that the project is there, and has room for a photo that it does not have."""
    if not project.photos.is_dir():
        raise NotFound("There is no such project.")
    n_present = len(project.photo_names())
    if n_present >= settings.max_photos:
        raise ProjectError(f"The project has {n_present} photos, which is the limit.")
    same = next((photo for photo, known in project.known_hashes().items() if known == sha256), None)
    if same is not None:
        raise ProjectError(f"{name} was uploaded already, as {same}.")


def _taken_names(folder: Path) -> list[str]:
    """Return all names in a folder: a photo must replace nothing, whatever it is."""
    return [entry.name for entry in os.scandir(folder)]


def is_video_name(name: str) -> bool:
    """Return whether a file of this name is taken as a video."""
    return name.lower().endswith(VIDEO_SUFFIXES)


def take_in_video(project: WebProject, upload: Path, filename: str, sha256: str) -> Path:
    """Move the complete file `upload` to the videos of `project`; the job that takes photos from it checks it.

    Raises
    ------
    FormatError
        When it is no video.
    NotFound
        When the project has been deleted.
    ProjectError
        When the project has this video already, or the Live Photo that it belongs to.
    DiskError
        When it cannot be stored.
    """
    name = _name_of_kind(filename, upload, VIDEO_SUFFIXES)
    if kind_of_file(upload) not in (VIDEO, None):
        raise FormatError(f"{name} is not a video that can be read. Export it as MP4 (H.264).")
    with only_writer(project.folder):
        if not project.photos.is_dir():
            raise NotFound("There is no such project.")
        photo = live_photo_of(name, VIDEO, project.photo_names())
        if photo is not None:
            raise ProjectError(f"{name} is the moving part of the Live Photo {photo}. The photo suffices.")
        size = upload.stat().st_size
        for known in project.video_names():
            other = project.videos / known
            if other.stat().st_size == size and file_sha256(other) == sha256:
                raise ProjectError(f"{name} was uploaded already, as {known}. Remove that one first to take it anew.")
        try:
            project.videos.mkdir(exist_ok=True)
            target = project.videos / free_name(name, _taken_names(project.videos))
            replace_file(upload, target)
        except OSError as error:
            raise write_problem(project.videos / name, error) from error
    return target
