"""Building XML that every parser reads."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping

_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot hold, not even escaped."""


def add(parent: ET.Element, name: str, text: object = None, attributes: Mapping[str, str] | None = None) -> ET.Element:
    """Add an element to `parent`; characters that XML cannot hold become U+FFFD."""
    element = ET.SubElement(parent, name, {key: _clean(value) for key, value in (attributes or {}).items()})
    if text is not None:
        element.text = _clean(str(text))
    return element


def xml_text(root: ET.Element) -> str:
    """Return a document of UTF-8, indented, with its declaration."""
    ET.indent(root, " ")
    return f"<?xml version='1.0' encoding='UTF-8'?>\n{ET.tostring(root, encoding='unicode')}\n"


def _clean(text: str) -> str:
    return _NOT_XML.sub("\ufffd", text)
