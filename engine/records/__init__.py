"""What is stored of an object, and the records that leave with it.

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
from .unit import describe_unit

__all__ = [
    "EXAMPLE_ADDRESS",
    "MUSEUM_RECORD_FILE",
    "RECORD_FILE",
    "MuseumRecord",
    "ObjectRecord",
    "Picture",
    "crm_json_ld",
    "describe_object",
    "describe_scene",
    "describe_unit",
    "dublin_core",
    "dublin_core_xml",
    "gltf_extras",
    "iiif_manifest",
    "lido_xml",
    "load_record",
    "found_again",
    "new_id",
    "new_name",
    "ply_comments",
    "read_record",
    "recorded_files",
    "rename_object",
    "save_record",
    "scene_title",
    "write_record",
    "xmp_packet",
]
