"""Every reader of the product with a small valid input, for `fuzz` and tests/security.

A reader that calls the functions of `engine.core.files`, and is in no entry here, fails tests/security/test_fuzz.py.
"""

from __future__ import annotations

from .reader import Reader
from .readers_installation import INSTALLATION
from .readers_models import MODELS
from .readers_packages import PACKAGES
from .readers_photos import PHOTOS
from .readers_project import PROJECT
from .readers_scene import SCENE
from .readers_serve import SERVE

READERS: tuple[Reader, ...] = (*PROJECT, *SERVE, *SCENE, *PHOTOS, *MODELS, *PACKAGES, *INSTALLATION)
