# SPDX-License-Identifier: GPL-3.0-or-later
"""Write the true meshes of the exhibits of a random room, in its own coordinates.

Requires a Python with bpy, opencv-python-headless and pillow.
"""

import sys
from pathlib import Path

if __name__ == "__main__":
    # In place of this folder, whose modules belong to a package.
    sys.path[0] = str(Path(__file__).resolve().parents[1])
    from random_rooms.true_meshes import main

    sys.exit(main(__doc__))
