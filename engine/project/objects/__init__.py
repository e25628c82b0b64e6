"""Stored objects: their own records, the museum records that a curator enters, and the trash.

Standard library and NumPy only: Blender reads them, too.
"""

from .museum_record import MUSEUM_RECORD_FILE, MuseumRecord, load_record, save_record
from .object_record import (
    EVIDENCE_FILE,
    MEMBERSHIP_FILE,
    PICTURE_FILE,
    RECORD_FILE,
    ObjectRecord,
    new_id,
    new_name,
    read_record,
    recorded_files,
    rename_object,
    write_record,
)
from .state_digest import UNREADABLE, object_states, state_of
from .storage import (
    detail_of,
    forget_unreadable_record,
    is_object_intact,
    load_level,
    load_levels,
    load_membership,
    membership_in,
    object_gaussians,
    require_intact,
    save_object,
)
from .stored_objects import list_objects, load_object, object_ids, taken_ids
from .trash import bring_back, delete_object, discard_object, empty_trash, keep_version, list_trash, restore_object
