# SPDX-License-Identifier: GPL-3.0-or-later
"""Render a random room from any cameras, without lens and noise.

Requires a Python with bpy, opencv-python-headless and pillow.
"""

import sys
from pathlib import Path

if __name__ == "__main__":
    # In place of this folder, whose modules belong to a package.
    sys.path[0] = str(Path(__file__).resolve().parents[1])
    from random_rooms.other_views import main

    sys.exit(main(__doc__))
