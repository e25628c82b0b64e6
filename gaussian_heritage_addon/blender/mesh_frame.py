"""The frame of an object's vertices relative to its project, also after *Apply*, *Set Origin* and *Join* changed it.

A mesh keeps the matrix from the normalised world of the project to its own frame. When its vertices were moved
together, as by *Apply*, that matrix follows; vertices joined from other objects, or moved singly, do not change it.
"""

from __future__ import annotations

import bpy
import numpy as np

from ...engine.core.arrays import Float64
from ...engine.core.errors import ObjectError
from .moved_vertices import main_move

_FRAME_KEY = "heritage_frame"
"""Custom property of a mesh: the matrix, row by row, from the normalised world of the project to the mesh."""
_NUMBER_KEY = "heritage_number"
"""Custom property of a mesh: the number of the vertices that were made for it; see `moved_vertices`."""
_MAX_ENTRY = 1e15


def keep_frame(mesh: bpy.types.Mesh, frame: Float64, number: int) -> None:
    """Store the frame [4, 4] of `mesh`, whose vertices were made with `number`."""
    mesh[_FRAME_KEY], mesh[_NUMBER_KEY] = frame.ravel().tolist(), number


def frame_of_mesh(mesh: bpy.types.Mesh) -> Float64:
    """Return the matrix [4, 4] from the normalised world of the project to `mesh`.

    Raises
    ------
    ObjectError
        When it was changed or removed by another program.
    """
    number = mesh.get(_NUMBER_KEY)
    # Without the number it cannot be known how the vertices moved since.
    stored = mesh.get(_FRAME_KEY) if isinstance(number, int) else None
    frame = stored_matrix(stored, f"The frame of {mesh.name}")
    moved: Float64 = main_move(mesh, number) @ frame
    return moved


def follow_frame(mesh: bpy.types.Mesh) -> None:
    """Store the frame that the vertices have now, before `mark_as_right` forgets how they moved.

    A frame that another program has changed stays as it is: whoever needs it says so.
    """
    try:
        frame = frame_of_mesh(mesh)
    except ObjectError:
        return
    mesh[_FRAME_KEY] = frame.ravel().tolist()


def stored_matrix(stored: object, what: str) -> Float64:
    """Return the matrix [4, 4] of a custom property, which can be inverted; `what` names it in messages.

    Raises
    ------
    ObjectError
        When it was changed by another program.
    """
    try:
        matrix = np.array([float(value) for value in stored]).reshape(4, 4)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        matrix = np.full((4, 4), np.nan)
    # Written so that NaN fails.
    if not (np.abs(matrix).max() <= _MAX_ENTRY and abs(np.linalg.det(matrix)) > 0):
        raise ObjectError(f"{what} was changed. Open the project in a new file.")
    return matrix
