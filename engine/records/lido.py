"""LIDO 1.1 (ICOM-CIDOC): the record of an object, with its digitisation as an event and its files as resources."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import Any

from .xml_text import add, xml_text

__all__ = ["lido_xml"]

_LIDO = "http://www.lido-schema.org"
_XML_LANG = "{http://www.w3.org/XML/1998/namespace}lang"
_XSI = "http://www.w3.org/2001/XMLSchema-instance"
_SCHEMA = "http://www.lido-schema.org http://www.lido-schema.org/schema/v1.1/lido-v1.1.xsd"
_LOCAL = {f"{{{_LIDO}}}type": "http://terminology.lido-schema.org/lido00100"}
"""Type of an identifier: "local identifier" in the terminology of LIDO."""
_LANGUAGE = "en"
"""Language of what this program writes. In which language a curator writes is not known."""


def lido_xml(described: dict[str, Any], files: Sequence[tuple[str, str]] = ()) -> str:
    """Return the LIDO record of an object or scene as an XML document.

    Parameters
    ----------
    described : dict
        As returned by `describe_scene` or `describe_object`.
    files : sequence of (str, str)
        Path in the package and media type of the files that show it.

    Returns
    -------
    str
        A ``lido:lidoWrap`` with one record.
    """
    ET.register_namespace("lido", _LIDO)
    ET.register_namespace("xsi", _XSI)
    root = ET.Element(_tag("lidoWrap"), {f"{{{_XSI}}}schemaLocation": _SCHEMA})
    record = _add(root, "lido")
    number = (described.get("object") or {}).get("catalogue_number") or described["identifier"] or described["title"]
    _add(record, "lidoRecID", f"gaussian-heritage/{number}", _LOCAL)
    _describe(_add(record, "descriptiveMetadata", attributes={_XML_LANG: _LANGUAGE}), described)
    administrative = _add(record, "administrativeMetadata", attributes={_XML_LANG: _LANGUAGE})
    _administrate(administrative, described, number, files)
    return xml_text(root)


def _describe(parent: ET.Element, described: dict[str, Any]) -> None:
    item = described.get("object") or {}
    classification = _add(parent, "objectClassificationWrap")
    work_type = _add(_add(classification, "objectWorkTypeWrap"), "objectWorkType")
    _add(work_type, "term", "museum object" if item else "scene with museum objects")
    identification = _add(parent, "objectIdentificationWrap")
    titles = _add(_add(identification, "titleWrap"), "titleSet")
    _add(titles, "appellationValue", described["title"], {_tag("pref"): "preferred"})
    if item.get("catalogue_number"):
        repository = _add(_add(identification, "repositoryWrap"), "repositorySet")
        _add(repository, "workID", item["catalogue_number"], _LOCAL)
    if item.get("notes"):
        note = _add(_add(identification, "objectDescriptionWrap"), "objectDescriptionSet")
        _add(note, "descriptiveNoteValue", item["notes"])
    size = described.get("size")
    if size:
        _measure(_add(_add(identification, "objectMeasurementsWrap"), "objectMeasurementsSet"), size)
    _digitisation(_add(_add(parent, "eventWrap"), "eventSet"), described)


def _measure(parent: ET.Element, size: dict[str, Any]) -> None:
    _add(parent, "displayObjectMeasurements", size["text"])
    measurements = _add(parent, "objectMeasurements")
    for name in ("width", "depth", "height"):
        one = _add(measurements, "measurementSet")
        _add(one, "measurementType", name)
        _add(one, "measurementUnit", "m")
        _add(one, "measurementValue", f"{size[f'{name}_metres']:.4f}")


def _digitisation(event_set: ET.Element, described: dict[str, Any]) -> None:
    photos = [photo for photo in described["captures"] if photo["use"] != "not used"]
    _add(event_set, "displayEvent", f"Reconstruction as 3D Gaussians from {len(photos)} photographs")
    event = _add(event_set, "event")
    _add(_add(event, "eventType"), "term", "Digitization")
    times = sorted(step["finished"] for step in described["steps"] if step["finished"])
    if times:
        date = _add(_add(event, "eventDate"), "date")
        _add(date, "earliestDate", times[0])
        _add(date, "latestDate", times[-1])
    for step in described["steps"]:
        note = _add(event, "eventDescriptionSet")
        _add(note, "descriptiveNoteValue", _step_text(step))


def _step_text(step: dict[str, Any]) -> str:
    parts = [step["what"]]
    if step["software"]:
        parts.append(f"Gaussian Heritage {step['software'].get('gaussian heritage', '')}".strip())
    if step["commit"]:
        parts.append(f"commit {step['commit']}{' with changes' if step['changed'] else ''}")
    if step["seed"] is not None:
        parts.append(f"seed {step['seed']}")
    psnr = step["results"].get("psnr")
    if isinstance(psnr, int | float):
        parts.append(f"PSNR {psnr:.1f} dB")
    return ", ".join(parts)


def _administrate(parent: ET.Element, described: dict[str, Any], number: str, files: Sequence[tuple[str, str]]) -> None:
    item, exported = described.get("object") or {}, described["exported"]
    if item.get("rights"):
        rights = _add(_add(parent, "rightsWorkWrap"), "rightsWorkSet")
        _add(rights, "creditLine", item["rights"])
    record = _add(parent, "recordWrap")
    _add(record, "recordID", number, _LOCAL)
    _add(_add(record, "recordType"), "term", "item" if item else "collection")
    source = _add(_add(record, "recordSource"), "legalBodyName")
    _add(source, "appellationValue", f"Gaussian Heritage {exported['software']['gaussian heritage']} (software)")
    info = _add(record, "recordInfoSet")
    _add(info, "recordMetadataDate", exported["finished"])
    if not files:
        return
    resources = _add(parent, "resourceWrap")
    for name, media_type in files:
        resource = _add(resources, "resourceSet")
        _add(resource, "resourceID", name, _LOCAL)
        representation = _add(resource, "resourceRepresentation")
        _add(representation, "linkResource", name, {_tag("formatResource"): media_type})
        _add(_add(resource, "resourceType"), "term", media_type.split("/")[0])
        _add(resource, "resourceDescription", described["unit"]["text"] if media_type.startswith("model") else name)


def _add(parent: ET.Element, name: str, text: object = None, attributes: dict[str, str] | None = None) -> ET.Element:
    return add(parent, _tag(name), text, attributes)


def _tag(name: str) -> str:
    return f"{{{_LIDO}}}{name}"
