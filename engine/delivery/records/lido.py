"""LIDO 1.1 (ICOM-CIDOC): the record of an object, with its digitisation as an event and its files as resources."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import Any
from urllib.parse import quote

from .xml_text import add, xml_text

_LIDO = "http://www.lido-schema.org"
_XML_LANG = "{http://www.w3.org/XML/1998/namespace}lang"
_XSI = "http://www.w3.org/2001/XMLSchema-instance"
_SCHEMA = "http://www.lido-schema.org http://www.lido-schema.org/schema/v1.1/lido-v1.1.xsd"
_TERMS = "http://terminology.lido-schema.org/"
_TYPE = f"{{{_LIDO}}}type"
_LOCAL, _URI = {_TYPE: f"{_TERMS}lido00100"}, {_TYPE: f"{_TERMS}lido00099"}
"""Types of an identifier: "local identifier" and "URI" in the terminology of LIDO."""
_THIS_RECORD, _CREATED = {_TYPE: f"{_TERMS}lido00470"}, {_TYPE: f"{_TERMS}lido00472"}
"""Terms of LIDO: a set of facts is about the record itself, and its date is the date of creation."""
_PREFERRED = f"{_TERMS}lido00169"
_ITEM_LEVEL = f"{_TERMS}lido00141"
"""That a record describes a single object."""
_RESOURCES = {
    "image": ("digital image", "Views of {}"),
    "video": ("video recording", "Film of {}"),
    "text": ("web page", "Page that shows {}"),
}
_MODEL = ("3D model", "{} as 3D Gaussian splats")
"""Kind and description of a file by the first part of its media type; other files hold Gaussians."""
_LANGUAGE = "en"
"""Language of what this program writes. In which language a curator writes is not known."""


def lido_xml(described: dict[str, Any], files: Sequence[tuple[str, str]] = (), *, address: str = "") -> str:
    """Return the LIDO record of an object or scene as an XML document.

    Parameters
    ----------
    described : dict
        As returned by `describe_scene` or `describe_object`.
    files : sequence of (str, str)
        Path in the package and media type of the files that show it: pictures, films, pages, and files of Gaussians.
    address : str
        What links to these files begin with: where they are published, or the way to them from the record.

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
    _administrate(administrative, described, number)
    if files:
        _show(_add(administrative, "resourceWrap"), described, files, address)
    return xml_text(root)


def _describe(parent: ET.Element, described: dict[str, Any]) -> None:
    item = described.get("object") or {}
    classification = _add(parent, "objectClassificationWrap")
    work_type = _add(_add(classification, "objectWorkTypeWrap"), "objectWorkType")
    _add(work_type, "term", "museum object" if item else "scene with museum objects")
    identification = _add(parent, "objectIdentificationWrap")
    titles = _add(_add(identification, "titleWrap"), "titleSet")
    _add(titles, "appellationValue", described["title"], {_tag("pref"): _PREFERRED})
    if item.get("catalogue_number"):
        repository = _add(_add(identification, "repositoryWrap"), "repositorySet")
        # Without a type: whether it is an accession or an inventory number is not known.
        _add(repository, "workID", item["catalogue_number"])
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
        one = _add(measurements, "measurementsSet")
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


def _administrate(parent: ET.Element, described: dict[str, Any], number: str) -> None:
    item, exported = described.get("object") or {}, described["exported"]
    if item.get("rights"):
        rights = _add(_add(parent, "rightsWorkWrap"), "rightsWorkSet")
        _add(rights, "creditLine", item["rights"])
    record = _add(parent, "recordWrap")
    _add(record, "recordID", number, _LOCAL)
    record_type = _add(record, "recordType")
    if item:
        _add(record_type, "conceptID", _ITEM_LEVEL, _URI)
    _add(record_type, "term", "Item-level record" if item else "Group-level record")
    source = _add(_add(record, "recordSource"), "legalBodyName")
    _add(source, "appellationValue", f"Gaussian Heritage {exported['software']['gaussian heritage']} (software)")
    info = _add(record, "recordInfoSet", attributes=_THIS_RECORD)
    _add(info, "recordMetadataDate", exported["finished"], _CREATED)


def _show(parent: ET.Element, described: dict[str, Any], files: Sequence[tuple[str, str]], address: str) -> None:
    for name, media_type in files:
        kind, text = _RESOURCES.get(media_type.split("/")[0], _MODEL)
        text = text.format(described["title"])
        if kind == _MODEL[0]:
            text = f"{text}. {described['unit']['text']}"
        resource = _add(parent, "resourceSet")
        _add(resource, "resourceID", name, _LOCAL)
        representation = _add(resource, "resourceRepresentation")
        _add(representation, "linkResource", address + quote(name), {_tag("formatResource"): media_type})
        _add(_add(resource, "resourceType"), "term", kind)
        _add(resource, "resourceDescription", text)


def _add(parent: ET.Element, name: str, text: object = None, attributes: dict[str, str] | None = None) -> ET.Element:
    return add(parent, _tag(name), text, attributes)


def _tag(name: str) -> str:
    return f"{{{_LIDO}}}{name}"
