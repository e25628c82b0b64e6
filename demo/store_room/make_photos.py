# SPDX-License-Identifier: GPL-3.0-or-later
"""Render the store room: photos like those of a phone, with true cameras and instance masks.

Requires a Python with bpy, opencv-python-headless and pillow. Existing photos are kept.
"""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent

if __name__ == "__main__":
    sys.path.insert(0, str(HERE.parent))
    from studio.shoot import main

    main(HERE, __doc__)
