"""Public names of a package, imported on first use: ``python -m engine --help`` must not wait for torch.

A package's ``__init__.py`` lists its public names as ordinary imports below ``if TYPE_CHECKING:``, where editors, mypy
and import-linter read them, and ends with ``__getattr__ = lazy_exports(__name__, __file__)`` (PEP 562).
"""

from __future__ import annotations

import ast
import functools
import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .parts import part


def lazy_exports(package: str, file: str) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a package that imports the modules behind its public names when they are used.

    Parameters
    ----------
    package : str
        Its ``__name__``.
    file : str
        Its ``__file__``, which holds the imports below ``if TYPE_CHECKING:``.

    Raises
    ------
    AttributeError
        By the returned function, for a name that the package does not export.
    """

    @functools.cache
    def modules() -> dict[str, str]:
        return _modules_of_names(Path(file).read_text(encoding="utf-8"))

    def get(name: str) -> Any:
        if name.startswith("__") or name not in modules():
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module = f"{package}.{modules()[name]}"
        if module not in sys.modules:
            with part("imports"):
                importlib.import_module(module)
        # Another thread may be importing it, which is waited for. The name is not kept here: a test that replaces it in
        # its own module must be seen.
        return getattr(importlib.import_module(module), name)

    return get


def _modules_of_names(source: str) -> dict[str, str]:
    """Return name: module for each relative import below ``if TYPE_CHECKING:``."""
    return {
        alias.name: statement.module
        for node in ast.parse(source).body
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
        for statement in node.body
        if isinstance(statement, ast.ImportFrom) and statement.level == 1 and statement.module
        for alias in statement.names
    }
