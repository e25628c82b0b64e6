"""Stored records of objects, and the records that leave with them.

An object's own record and the museum record that a curator enters are files of the project. From these and from what
the stages recorded, `describe_scene` and `describe_object` gather the paradata, of which every other form is made:
Dublin Core, LIDO, JSON-LD (CRMdig), a IIIF manifest, comments of PLY and metadata of glTF.

Standard library and NumPy only: Blender exports files too.
"""

from .crm import crm_json_ld
from .dublin import dublin_core, dublin_core_xml
from .embedded import gltf_extras, ply_comments, xmp_packet
from .iiif import EXAMPLE_ADDRESS, Picture, iiif_manifest
from .lido import lido_xml
from .museum_record import MUSEUM_RECORD_FILE, MuseumRecord, load_record, save_record
from .object_record import (
    COMPUTED_FILES,
    LEVELS_FILE,
    MEMBERSHIP_FILE,
    PICTURE_FILE,
    POLISHED_FILE,
    RECORD_FILE,
    ObjectRecord,
    found_again,
    new_id,
    new_name,
    read_record,
    recorded_files,
    rename_object,
    write_record,
)
from .paradata import describe_object, describe_scene, scene_title
from .state_digest import UNREADABLE, object_states, state_of
from .stored_objects import list_objects, load_object, object_ids, taken_ids
from .trash import bring_back, delete_object, discard_object, empty_trash, keep_version, list_trash, restore_object
from .unit import describe_unit

__all__ = [
    "COMPUTED_FILES",
    "EXAMPLE_ADDRESS",
    "LEVELS_FILE",
    "MEMBERSHIP_FILE",
    "MUSEUM_RECORD_FILE",
    "POLISHED_FILE",
    "PICTURE_FILE",
    "RECORD_FILE",
    "UNREADABLE",
    "MuseumRecord",
    "ObjectRecord",
    "Picture",
    "bring_back",
    "crm_json_ld",
    "delete_object",
    "describe_object",
    "describe_scene",
    "discard_object",
    "describe_unit",
    "dublin_core",
    "dublin_core_xml",
    "empty_trash",
    "gltf_extras",
    "iiif_manifest",
    "keep_version",
    "lido_xml",
    "list_objects",
    "list_trash",
    "load_object",
    "load_record",
    "found_again",
    "new_id",
    "new_name",
    "object_ids",
    "object_states",
    "ply_comments",
    "read_record",
    "recorded_files",
    "rename_object",
    "restore_object",
    "save_record",
    "scene_title",
    "state_of",
    "taken_ids",
    "write_record",
    "xmp_packet",
]
