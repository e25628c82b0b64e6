"""Pictures of a trained scene in the pixels of its photos, and the contribution of Gaussians to sets of pixels."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .png import encode_png, write_png
    from .render import Subject, render_view, visible_masks
    from .scene import Rendered, Scene
    from .webp import decode_picture, encode_picture

__getattr__ = lazy_exports(__name__, __file__)
