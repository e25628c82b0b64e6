"""The languages of what users see: in Blender, on the page of the server, and in reports.

Standard library only: Blender reads them too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .reading import TEXTS, Language, Translate, languages

__getattr__ = lazy_exports(__name__, __file__)
