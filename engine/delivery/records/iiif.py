"""A IIIF Presentation 3 manifest of the pictures of a package."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote

EXAMPLE_ADDRESS = "https://example.org/"
"""Address in manifests of pictures that are published nowhere yet; IIIF demands one. RFC 2606 reserves it."""


@dataclass(frozen=True)
class Picture:
    """A picture of a package: its path below the manifest's address, its label and its size in pixels."""

    name: str
    label: str
    width: int
    height: int


def iiif_manifest(described: dict[str, Any], pictures: Sequence[Picture], *, address: str, name: str) -> dict[str, Any]:
    """Return the manifest with one canvas for each picture.

    Parameters
    ----------
    described : dict
        As returned by `describe_scene` or `describe_object`.
    pictures : sequence of Picture
        JPEG pictures, in the order in which a viewer turns them; at least one.
    address : str
        Where the folder with the pictures is, or will be, published: ``https://.../``.
    name : str
        Path of the manifest below `address`.
    """
    item = described.get("object") or {}
    manifest: dict[str, Any] = {
        "@context": "http://iiif.io/api/presentation/3/context.json",
        "id": address + quote(name),
        "type": "Manifest",
        "label": _text(described["title"]),
        "metadata": [
            {"label": _text(label), "value": _text(str(value))}
            for label, value in (
                ("Catalogue number", item.get("catalogue_number")),
                ("Made with", f"Gaussian Heritage {described['exported']['software']['gaussian heritage']}"),
                ("Unit of length", described["unit"]["text"]),
                ("Identifier", described["identifier"]),
            )
            if value
        ],
        "behavior": ["individuals"],
        "items": [_canvas(picture, address) for picture in pictures],
    }
    if item.get("notes"):
        manifest["summary"] = _text(item["notes"])
    if item.get("rights"):
        manifest["requiredStatement"] = {"label": _text("Rights"), "value": _text(item["rights"])}
    return manifest


def _canvas(picture: Picture, address: str) -> dict[str, Any]:
    picture_id = address + quote(picture.name)
    size = {"width": picture.width, "height": picture.height}
    body = {"id": picture_id, "type": "Image", "format": "image/jpeg", **size}
    annotation = {
        "id": f"{picture_id}/annotation",
        "type": "Annotation",
        "motivation": "painting",
        "body": body,
        "target": f"{picture_id}/canvas",
    }
    page = {"id": f"{picture_id}/page", "type": "AnnotationPage", "items": [annotation]}
    return {
        "id": f"{picture_id}/canvas",
        "type": "Canvas",
        "label": _text(picture.label),
        **size,
        "items": [page],
    }


def _text(text: str) -> dict[str, list[str]]:
    """Return a language map; in which language a curator writes is not known."""
    return {"none": [text]}
