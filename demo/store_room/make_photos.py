# SPDX-License-Identifier: GPL-3.0-or-later
"""Render the store room: photos as from a phone, with true cameras and instance masks.

Run it with a Python that has bpy, opencv-python-headless and pillow. Photos already there are kept.
"""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent

if __name__ == "__main__":
    sys.path.insert(0, str(HERE.parent))
    from studio.shoot import main

    main(HERE, __doc__)
