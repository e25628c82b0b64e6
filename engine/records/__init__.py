"""What is stored of an object: its own record, and the museum record that a curator enters."""

from .museum_record import MuseumRecord, load_record, save_record
from .object_record import (
    RECORD_FILE,
    ObjectRecord,
    new_id,
    new_name,
    read_record,
    recorded_files,
    rename_object,
    write_record,
)

__all__ = [
    "RECORD_FILE",
    "MuseumRecord",
    "ObjectRecord",
    "load_record",
    "new_id",
    "new_name",
    "read_record",
    "recorded_files",
    "rename_object",
    "save_record",
    "write_record",
]
