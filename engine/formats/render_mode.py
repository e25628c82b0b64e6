"""How files say that their Gaussians were trained anti-aliased, with the 2D filter of Mip-Splatting (Yu et al. 2024).

Brush, and splat-transform after it, write the comment ``SplatRenderMode: mip`` into a PLY, Postshot ``antialiased 1``.
SPZ has a flag and SOG a key for it. GLB and USD have no place of their own: there our files say it as PLY does.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

ANTIALIASED_NOTE = "They were trained anti-aliased (mip), and are drawn so."
RENDER_MODE_KEY = "SplatRenderMode"
RENDER_MODE = {True: "mip", False: "default"}
_MODE = re.compile(r"(?:comment|obj_info)\s+splatrendermode\s*[:=]?\s*(\w+)\s*", re.IGNORECASE)
_FLAG = re.compile(r"(?:comment|obj_info)\s+anti[-_ ]?aliased\s*[:=]?\s*(1|0|true|false)\s*", re.IGNORECASE)


def is_antialiased(header: Sequence[str]) -> bool:
    """Return what the lines of a PLY header say; the last one that says something counts."""
    found = False
    for line in header:
        mode, flag = _MODE.fullmatch(line), _FLAG.fullmatch(line)
        if mode is not None:
            found = mode[1].lower() == RENDER_MODE[True]
        elif flag is not None:
            found = flag[1].lower() in ("1", "true")
    return found


def without_mode(header: Sequence[str]) -> list[str]:
    """Return the lines of a PLY header without those that say how the Gaussians were trained."""
    return [line for line in header if _MODE.fullmatch(line) is None and _FLAG.fullmatch(line) is None]
