"""Makes the repository importable as one package, like the installed extension in Blender, but without bpy."""

from __future__ import annotations

import sys
import types

from tests.conftest import ROOT

PACKAGE = "gaussian_heritage_without_blender"

# Empty parent packages: modules that need no bpy can be imported without running the add-on's __init__, which needs it.
for name in (PACKAGE, f"{PACKAGE}.gaussian_heritage_addon"):
    module = types.ModuleType(name)
    module.__path__ = [str(ROOT.joinpath(*name.split(".")[1:]))]
    sys.modules.setdefault(name, module)
