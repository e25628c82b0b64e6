"""Which state an object of a project is in: a digest of its Gaussians and of how it was made.

The name and the museum record are no part of it: a user changes them alone, and they are stored as they are.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from ...core.errors import HeritageError
from ...core.files import object_file
from ...core.settings import to_dict
from .object_record import RECORD_FILE, read_record, recorded_files
from .stored_objects import object_ids

UNREADABLE = "unreadable"
"""State of an object whose record cannot be read; it equals no other."""


def state_of(folder: Path) -> str:
    """Return the state of the object in `folder`, 64 hexadecimal digits; equal for a copy of it in the trash.

    Raises
    ------
    FormatError
        When its record is damaged.
    """
    file = folder / RECORD_FILE
    described = {key: value for key, value in to_dict(read_record(file)).items() if key not in ("id", "name")}
    text = json.dumps([described, recorded_files(file)], sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def object_states(project: Path) -> dict[str, str]:
    """Return the state of each object of a project folder by id; `UNREADABLE` where its record is damaged.

    Raises
    ------
    FormatError
        When the folder of an object is a link that leads out of the project.
    """
    found = {}
    for object_id in object_ids(project):
        folder = object_file(project, object_id, RECORD_FILE).parent
        try:
            found[object_id] = state_of(folder)
        except HeritageError:
            found[object_id] = UNREADABLE
    return found
