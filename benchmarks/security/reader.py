"""What `fuzz` knows of a reader."""

from __future__ import annotations

import importlib
import sys
import types
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..places import ROOT

_PACKAGE = "gaussian_heritage_without_blender"


@dataclass(frozen=True)
class Reader:
    """A reader of the product and a small valid input of it.

    Attributes
    ----------
    name : str
        Also the name of the folder of its damaged inputs in tests/fixtures/damaged.
    write : callable
        Writes the valid input into an empty folder.
    read : callable
        Reads it from there. Returns None when the reader ignores the input, and something else when it accepts it.
    files : tuple of str
        Files of the input that are damaged. The suffix names the kind of damage, see `mutations.KINDS`.
    share : float
        Share of the time, relative to other readers.
    takes_text : bool
        Whether the product's reader takes text or a stream, so that `read` opens the file itself.
    """

    name: str
    write: Callable[[Path], object]
    read: Callable[[Path], object]
    files: tuple[str, ...]
    share: float = 1.0
    takes_text: bool = False


def addon(module: str) -> Any:
    """Return a module of the add-on that needs no bpy."""
    # Empty parent packages: the add-on's own `__init__` needs bpy.
    for name in (_PACKAGE, f"{_PACKAGE}.gaussian_heritage_addon"):
        package = types.ModuleType(name)
        package.__path__ = [str(ROOT.joinpath(*name.split(".")[1:]))]
        sys.modules.setdefault(name, package)
    return importlib.import_module(f"{_PACKAGE}.gaussian_heritage_addon.{module}")
