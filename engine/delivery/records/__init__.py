"""The records that leave with an object.

From an object's own record, the museum record that a curator enters, and what the stages recorded, `describe_scene` and
`describe_object` gather the paradata, of which every other form is made: Dublin Core, LIDO, JSON-LD (CRMdig), a IIIF
manifest, comments of PLY and metadata of glTF.

Standard library and NumPy only: Blender exports files too.
"""

from .crm import crm_json_ld
from .dublin import dublin_core, dublin_core_xml
from .embedded import ply_comments, record_summary, xmp_packet
from .iiif import EXAMPLE_ADDRESS, Picture, iiif_manifest
from .lido import lido_xml
from .paradata import describe_object, describe_scene, scene_title
from .unit import describe_unit
