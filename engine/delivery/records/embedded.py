"""What an exported file says of itself: comments of PLY, ``asset.extras`` and XMP of glTF."""

from __future__ import annotations

from typing import Any

_FIELDS = ("catalogue_number", "rights", "notes")
_CONTEXT = {
    "dc": "http://purl.org/dc/elements/1.1/",
    "rdf": "http://www.w3.org/1999/02/22-rdf-syntax-ns#",
    "xmp": "http://ns.adobe.com/xap/1.0/",
    "xmpRights": "http://ns.adobe.com/xap/1.0/rights/",
}


def record_summary(described: dict[str, Any], *, frame: str) -> dict[str, Any]:
    """Return the summary of a record as JSON values: ``asset.extras`` of glTF, and the comments of other formats.

    Parameters
    ----------
    described : dict
        As returned by `describe_scene` or `describe_object`.
    frame : {"upright", "original"}
        Frame of the exported coordinates.

    Returns
    -------
    dict
        Values that are not known are left out; ``unit`` is always there.
    """
    item, exported = described.get("object") or {}, described["exported"]
    training: dict[str, Any] = next((step for step in described["steps"] if step["stage"] == "training"), {})
    trained = training.get("results") or {}
    used = [photo for photo in described["captures"] if photo["use"] != "not used"]
    summary = {
        "title": described["title"],
        "scene": described.get("scene_title"),
        **{name: item.get(name) for name in _FIELDS},
        "unit": described["unit"]["text"],
        "metres_per_unit": described["unit"]["metres_per_unit"],
        "frame": frame,
        "size": (described.get("size") or {}).get("text"),
        "identifier": described["identifier"],
        "photos": len(used) or None,
        "photos_taken": _dates(described["captures"]),
        "prompt": _prompt(item),
        "threshold": item.get("threshold"),
        "confidence": item.get("confidence"),
        "agreement_with_mask": item.get("agreement"),
        "hand_corrections": (item.get("hand_edits") or {}).get("corrections"),
        "psnr_of_test_photos_db": _rounded(trained.get("psnr")),
        "trained": training.get("finished"),
        "seed": training.get("seed"),
        "trained_commit": training.get("commit"),
        "exported": exported["finished"],
        "software": f"Gaussian Heritage {exported['software']['gaussian heritage']}",
        "commit": _commit(exported),
    }
    return {name: value for name, value in summary.items() if value is not None}


def ply_comments(extras: dict[str, Any]) -> list[str]:
    """Return the values of `record_summary`, and others, as header comments of a PLY file, ``name value``."""
    known = {name: value for name, value in extras.items() if value is not None}
    return [*(f"{name} {value}" for name, value in known.items()), "generator Gaussian Heritage"]


def xmp_packet(described: dict[str, Any]) -> dict[str, Any]:
    """Return a packet of the extension KHR_xmp_json_ld: title, identifier, rights, description and dates."""
    item, exported = described.get("object") or {}, described["exported"]
    identifiers = [value for value in (item.get("catalogue_number"), described["identifier"]) if value]
    packet: dict[str, Any] = {
        "@context": _CONTEXT,
        "dc:title": _in_any_language(described["title"]),
        "dc:type": {"@set": ["Gaussian splats"]},
        "dc:format": "model/gltf-binary",
        "dc:description": _in_any_language(item.get("notes") or described["unit"]["text"]),
        "xmp:CreatorTool": f"Gaussian Heritage {exported['software']['gaussian heritage']}",
        "xmp:MetadataDate": exported["finished"],
    }
    if identifiers:
        packet["dc:identifier"] = identifiers[0]
    if item.get("rights"):
        packet["dc:rights"] = _in_any_language(item["rights"])
        packet["xmpRights:Marked"] = True
    return packet


def _in_any_language(text: str) -> dict[str, Any]:
    """Return a language alternative of XMP; in which language a curator writes is not known."""
    return {"@type": "rdf:Alt", "rdf:_1": {"@language": "x-default", "@value": text}}


def _prompt(item: dict[str, Any]) -> str | None:
    prompt = item.get("prompt") or {}
    if prompt.get("text"):
        return str(prompt["text"])
    return (
        f"{prompt['kind']} in {prompt['photo']}" if prompt.get("kind") and prompt.get("photo") else prompt.get("kind")
    )


def _dates(captures: list[dict[str, Any]]) -> str | None:
    """Return the first and last day of the photos, where EXIF was read."""
    days = sorted(date[:10] for photo in captures if (date := (photo.get("exif") or {}).get("taken")))
    return None if not days else days[0] if days[0] == days[-1] else f"{days[0]} to {days[-1]}"


def _commit(run: dict[str, Any]) -> str | None:
    return None if run["commit"] is None else run["commit"] + (" with changes" if run["changed"] else "")


def _rounded(value: Any) -> float | None:
    return round(value, 2) if isinstance(value, int | float) else None
