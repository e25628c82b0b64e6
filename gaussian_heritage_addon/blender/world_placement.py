"""Where objects stand in Blender's world. No other module reads or sets ``matrix_world``.

Blender computes ``matrix_world`` only for objects that it evaluates. After a file was loaded it is the identity for
those that are hidden (``hide_viewport``), and after a script has moved an object it is the former one. The channels of
an object and of its parents are always right. What depends on more, such as a constraint, is evaluated on request.
"""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ...engine.core.arrays import Float64
from ...engine.core.errors import ObjectError

_PLAIN_PARENTS = ("OBJECT", "ARMATURE", "LATTICE")
"""Kinds of parents whose matrix alone moves a child; the others are vertices and bones."""
_TOLERANCE = 1e-4
"""Largest difference, relative to the size of a matrix, between a wanted placement and that of Blender's float32."""


def world_matrix(obj: bpy.types.Object) -> Float64:
    """Return the matrix [4, 4] from the frame of `obj` to Blender's world, whether it is shown or hidden.

    Raises
    ------
    ObjectError
        When a simulation moves the object while it is hidden, or it is its own parent.

    Notes
    -----
    Not to be called while Blender draws: constraints, animations, and vertices and bones as parents are evaluated in a
    scene that is made for this and removed again, unless the object is shown. See `drawn_matrix`.
    """
    if all(_is_plain(one) for one in (obj, *parents_of(obj))):
        return _from_channels(obj)
    return _evaluated(obj)


def drawn_matrix(obj: bpy.types.Object) -> Matrix:
    """Return the placement with which Blender draws `obj`, while it draws.

    It differs from `world_matrix` where constraints or an animation move a hidden object.
    """
    if all(_is_plain(one) for one in (obj, *parents_of(obj))):
        return Matrix(_from_channels(obj).tolist())
    return obj.matrix_world.copy()


def set_world_matrix(obj: bpy.types.Object, matrix: NDArray[np.floating]) -> None:
    """Place `obj` by a matrix [4, 4] from its frame to Blender's world; parents stay where they are.

    Raises
    ------
    ObjectError
        When the object cannot stand there: it is linked from another file, constraints or an animation move it, or
        it would be sheared. It stays where it was.
    """
    if obj.library is not None:
        file = bpy.path.abspath(obj.library.filepath)
        raise ObjectError(
            f"{obj.name} is linked from {file} and can only be moved there. Open that file, or make the object local "
            "(Object > Relations > Make Local)."
        )
    wanted = np.asarray(matrix, np.float64)
    former = obj.matrix_basis.copy(), obj.matrix_parent_inverse.copy()
    parent = _parent_matrix(obj)
    try:
        obj.matrix_basis = Matrix(np.linalg.solve(parent, wanted).tolist())
        if not _is_near(parent @ np.array(obj.matrix_basis, np.float64), wanted) and obj.parent is not None:
            # Location, rotation and scale hold no shear; the inverse of the parent does.
            basis, inverse = (np.array(one, np.float64) for one in former)
            obj.matrix_basis = former[0]
            obj.matrix_parent_inverse = Matrix(
                (inverse @ np.linalg.solve(parent, wanted @ np.linalg.inv(basis))).tolist()
            )
        stands = _is_near(world_matrix(obj), wanted)
    except np.linalg.LinAlgError:
        stands = False
    if not stands:
        obj.matrix_basis, obj.matrix_parent_inverse = former
        raise ObjectError(_why_not(obj))
    if obj.parent_type in _PLAIN_PARENTS:
        # What other add-ons read until Blender evaluates the object. This sets its channels, too, as if the parent
        # still stood where it was evaluated.
        basis_now = obj.matrix_basis.copy()
        obj.matrix_world = Matrix(wanted.tolist())
        obj.matrix_basis = basis_now


def copy_world_matrix(obj: bpy.types.Object, source: bpy.types.Object, shift: Float64 | None = None) -> None:
    """Place `obj` where `source` stands, with its origin at `shift` [3] in the frame of `source`.

    Where a parent of `source` shears it, `obj` gets the same parent.

    Raises
    ------
    ObjectError
        As `set_world_matrix`.
    """
    moved = np.eye(4)
    moved[:3, 3] = 0.0 if shift is None else shift
    matrix = world_matrix(source) @ moved
    try:
        set_world_matrix(obj, matrix)
    except ObjectError:
        if source.parent is None:
            raise
        obj.parent, obj.parent_type = source.parent, "OBJECT"
        set_world_matrix(obj, matrix)


def parents_of(obj: bpy.types.Object) -> Iterator[bpy.types.Object]:
    """Yield the parent of `obj`, its parent, and so on.

    Raises
    ------
    ObjectError
        When an object is its own parent, in a file that another program has changed.
    """
    seen = {obj}
    while obj.parent is not None:
        obj = obj.parent
        if obj in seen:
            raise ObjectError(f"{obj.name} is its own parent. Clear its parent (Alt+P).")
        seen.add(obj)
        yield obj


def _from_channels(obj: bpy.types.Object) -> Float64:
    """Return the placement of an object that follows from the channels of it and its parents alone."""
    matrix = np.array(obj.matrix_basis, np.float64)
    for parent in parents_of(obj):
        inverse = np.array(obj.matrix_parent_inverse, np.float64)
        matrix = np.array(parent.matrix_basis, np.float64) @ inverse @ matrix
        obj = parent
    return matrix


def _is_plain(obj: bpy.types.Object) -> bool:
    """Return whether nothing but its channels and its parent move `obj`."""
    if any(not one.mute for one in obj.constraints) or (obj.rigid_body is not None and obj.rigid_body.type == "ACTIVE"):
        return False
    animation = obj.animation_data
    if animation is not None and (animation.action is not None or animation.nla_tracks or animation.drivers):
        return False
    parent = obj.parent
    if parent is None:
        return True
    follows_curve = parent.type == "CURVE" and parent.data.use_path
    return obj.parent_type in _PLAIN_PARENTS and not follows_curve


def _parent_matrix(obj: bpy.types.Object) -> Float64:
    """Return what takes the channels of `obj` to its placement."""
    if obj.parent is None:
        return np.eye(4)
    if obj.parent_type in _PLAIN_PARENTS:
        return world_matrix(obj.parent) @ np.array(obj.matrix_parent_inverse, np.float64)
    return world_matrix(obj) @ np.linalg.inv(np.array(obj.matrix_basis, np.float64))


def _is_near(matrix: Float64, wanted: Float64) -> bool:
    linear = np.abs(matrix[:3, :3] - wanted[:3, :3]).max() <= _TOLERANCE * np.abs(wanted[:3, :3]).max()
    size = np.abs(wanted[:3]).max()
    # Written so that NaN fails.
    return bool(linear and np.abs(matrix[:3, 3] - wanted[:3, 3]).max() <= _TOLERANCE * size)


def _why_not(obj: bpy.types.Object) -> str:
    if not _is_plain(obj):
        return (
            f"{obj.name} cannot be placed, because a constraint, an animation or its parent moves it. Use Object > "
            "Apply > Visual Transform, and remove what moves it."
        )
    return (
        f"{obj.name} cannot be placed, because its scale is 0 or it would be sheared. Apply the scale of its parents "
        "(Ctrl+A)."
    )


def _evaluated(obj: bpy.types.Object) -> Float64:
    """Return the placement of an object that Blender has to evaluate."""
    scenes = sorted(obj.users_scene, key=lambda one: one != bpy.context.scene)
    for scene in scenes:
        for layer in scene.view_layers:
            if obj.visible_get(view_layer=layer):
                layer.update()
                return np.array(obj.evaluated_get(layer.depsgraph).matrix_world, np.float64)
    for one in (obj, *parents_of(obj)):
        if one.rigid_body is not None and one.rigid_body.type == "ACTIVE":
            raise ObjectError(f"{one.name} is hidden, and a simulation moves it. Show it, or remove its rigid body.")
    return _evaluated_hidden(obj, scenes[0] if scenes else bpy.context.scene)


def _evaluated_hidden(obj: bpy.types.Object, scene: bpy.types.Scene) -> Float64:
    """Return where `obj` would stand if it were shown in `scene`.

    A helper in a scene of its own copies its placement: for that, Blender evaluates the object although it is hidden.
    """
    own = bpy.data.scenes.new("Heritage Placement")
    helper = bpy.data.objects.new("Heritage Placement", None)
    try:
        own.collection.objects.link(helper)
        helper.constraints.new("COPY_TRANSFORMS").target = obj
        own.frame_current, own.frame_subframe = scene.frame_current, scene.frame_subframe
        layer = own.view_layers[0]
        layer.update()
        return np.array(helper.evaluated_get(layer.depsgraph).matrix_world, np.float64)
    finally:
        bpy.data.objects.remove(helper)
        bpy.data.scenes.remove(own)
