"""The engine's Python environment: installed, repaired, updated and removed, with or without a network.

Standard library only: it runs before any package is installed, in Blender's Python or another one.
``python -m engine.install.environment --help`` lists its commands.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .contents import CONTENTS, sizes
    from .environment import EngineEnvironment, default_folder
    from .locked import locked_arguments, locked_file, pinned
    from .pip_command import Pip, run_logged
    from .pythons import find_python, usable
    from .torch_builds import TorchSource, default_build, torch_source

__getattr__ = lazy_exports(__name__, __file__)
