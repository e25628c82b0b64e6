"""The settings that pictures, evaluation and the published method share."""

from __future__ import annotations

VISIBLE_SHARE = 0.5
"""Share of a pixel above which a set of Gaussians is what the pixel shows: no other set can contribute as much."""
