"""Syntax trees of sources, made once for all tests of this folder, which read the same modules for different rules."""

from __future__ import annotations

import ast
import functools
import gc


@functools.cache
def parsed(source: str) -> ast.Module:
    """Return the tree of a module's source; nobody changes it."""
    # The search for garbage in cycles visits the nodes made so far again and again: two thirds of the time.
    gc.disable()
    try:
        return ast.parse(source)
    finally:
        gc.enable()


@functools.cache
def nodes(source: str) -> tuple[ast.AST, ...]:
    """Return all nodes of a module's source, in the order of `ast.walk`."""
    return tuple(ast.walk(parsed(source)))
