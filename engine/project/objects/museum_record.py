"""Museum record of an object (catalogue number, title, rights, notes), stored in ``objects/<id>/record.json``."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from pathlib import Path

from ...core.errors import FormatError
from ...core.files import object_file, optional, read_versioned, write_json

RECORD_VERSION = 1
MUSEUM_RECORD_FILE = "record.json"


@dataclass(frozen=True)
class MuseumRecord:
    """Description of an object by the museum. Fields that were not filled in are empty.

    Attributes
    ----------
    catalogue_number : str
        Accession or inventory number.
    title : str
        Name of the object.
    rights : str
        Credit line, licence or rights statement.
    notes : str
        Free text.
    """

    catalogue_number: str = ""
    title: str = ""
    rights: str = ""
    notes: str = ""

    def as_dict(self) -> dict[str, str]:
        """Return the fields that are not empty."""
        return {name: value for name, value in asdict(self).items() if value}

    def as_comments(self) -> list[str]:
        """Return header comments for a PLY file, one for each field that is not empty."""
        return [f"{name} {value}" for name, value in self.as_dict().items()]


def save_record(project: Path, object_id: str, record: MuseumRecord) -> None:
    """Write the record of an object to the project folder `project` atomically.

    Raises
    ------
    DiskError
        When the file cannot be written.
    FormatError
        When `object_id` is not the name of a folder of the project.
    """
    write_json(object_file(project, object_id, MUSEUM_RECORD_FILE), {"version": RECORD_VERSION, **asdict(record)})


def load_record(project: Path, object_id: str) -> MuseumRecord:
    """Return the record of an object, an empty one when it has no file.

    Raises
    ------
    FormatError
        When the file cannot be read.
    """
    file = object_file(project, object_id, MUSEUM_RECORD_FILE)
    if not file.exists():
        return MuseumRecord()
    advice = "Repair it or move it away."
    names = [f.name for f in fields(MuseumRecord)]
    data = read_versioned(file, {name: optional(str) for name in names}, version=RECORD_VERSION, advice=advice)
    record = MuseumRecord(**{name: data.get(name, "") for name in names})
    if any("\0" in value for value in asdict(record).values()):
        raise FormatError(f"{file} cannot be read: it has a null character. {advice}")
    return record
