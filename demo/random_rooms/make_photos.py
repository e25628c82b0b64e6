# SPDX-License-Identifier: GPL-3.0-or-later
"""Render a random museum room: 24 photos, with true cameras and instance masks, from a seed.

Requires a Python with bpy, opencv-python-headless and pillow. Existing files are kept: a stopped run continues.
"""

import sys
from pathlib import Path

if __name__ == "__main__":
    # In place of this folder, whose modules belong to a package.
    sys.path[0] = str(Path(__file__).resolve().parents[1])
    from random_rooms.generate import main

    sys.exit(main(__doc__))
