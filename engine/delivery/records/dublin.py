"""Dublin Core: the fifteen elements (ISO 15836-1), as XML in the container that OAI-PMH uses."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any

from .xml_text import add, xml_text

_DC = "http://purl.org/dc/elements/1.1/"
_OAI_DC = "http://www.openarchives.org/OAI/2.0/oai_dc/"


def dublin_core(described: dict[str, Any]) -> list[tuple[str, str]]:
    """Return elements of Dublin Core and their values, as far as they are known; an element may repeat.

    Parameters
    ----------
    described : dict
        As returned by `describe_scene` or `describe_object`.
    """
    item, exported = described.get("object") or {}, described["exported"]
    photos = [photo for photo in described["captures"] if photo["use"] != "not used"]
    values: list[tuple[str, Any]] = [
        ("title", described["title"]),
        ("identifier", item.get("catalogue_number")),
        ("identifier", described["identifier"]),
        ("description", item.get("notes")),
        ("description", described["unit"]["text"]),
        ("rights", item.get("rights")),
        ("type", "InteractiveResource"),
        ("type", "3D Gaussian splats"),
        ("format", "model/gltf-binary"),
        ("format", "application/x-ply"),
        ("source", f"{len(photos)} photographs" if photos else None),
        ("date", exported["finished"]),
        ("contributor", f"Gaussian Heritage {exported['software']['gaussian heritage']} (software)"),
        ("relation", f"part of the scene {described['scene_title']}" if "scene_title" in described else None),
    ]
    return [(name, str(value)) for name, value in values if value]


def dublin_core_xml(described: dict[str, Any]) -> str:
    """Return `dublin_core` as an XML document with the root ``oai_dc:dc``."""
    ET.register_namespace("dc", _DC)
    ET.register_namespace("oai_dc", _OAI_DC)
    root = ET.Element(f"{{{_OAI_DC}}}dc")
    for name, value in dublin_core(described):
        add(root, f"{{{_DC}}}{name}", value)
    return xml_text(root)
