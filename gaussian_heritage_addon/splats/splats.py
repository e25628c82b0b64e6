"""Splat scenes in Blender: converts Gaussians to a mesh of vertices with attributes, and back.

Attribute names are those of the splats built into Blender 5.3, so that its tools recognise them.
"""

from __future__ import annotations

import contextlib
import secrets
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import bmesh
import bpy
import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float32
from ...engine.core.errors import ObjectError
from ...engine.formats import logits_of, transform_gaussians
from ...engine.scene import Gaussians, unit_quats
from ..blender.attributes import FOUR_FLOATS, VECTORS, read_attribute, write_attribute
from ..blender.mesh_frame import follow_frame, frame_of_mesh, keep_frame
from ..blender.moved_vertices import mark_as_right, moves_since
from ..blender.world_placement import world_matrix
from .native_splats import HARMONICS, number_of_harmonics
from .splat_material import COLOR_ATTRIBUTE
from .splat_nodes import ANTIALIASED, ANTIALIASED_KEY, add_display, set_display_input
from .stored_file import StoredFile, forget_lost_digits, stored_file, with_stored_values


@dataclass(frozen=True)
class SplatScene:
    """Gaussians as a Blender object.

    Attributes
    ----------
    name : str
        Name of the object. Names are unique in Blender, whereas a reference to the object is invalid after undo.
    """

    name: str

    @classmethod
    def create(
        cls,
        name: str,
        gaussians: Gaussians,
        collection: bpy.types.Collection,
        *,
        index: NDArray[np.integer] | None = None,
        membership: Float32 | None = None,
        frame: NDArray[np.float64] | None = None,
    ) -> SplatScene:
        """Create an object with `gaussians` in `collection`.

        Parameters
        ----------
        name : str
            Name of the object. Blender adds a number if the name is in use.
        gaussians : Gaussians
            Gaussians in the frame of the object.
        index : array of shape [N], int, optional
            Row of each Gaussian in the project's scene; 0 to N-1 by default.
        membership : array of shape [N], float32, optional
            Membership of each Gaussian in the object, compared with the threshold.
        frame : array of shape [4, 4], float64, optional
            Matrix from the normalised world of the project to the frame of the object; the identity by default.
        """
        mesh = bpy.data.meshes.new(name)
        number = _fill(mesh, gaussians, np.arange(len(gaussians)) if index is None else index, membership)
        keep_frame(mesh, np.eye(4) if frame is None else frame, number)
        obj = bpy.data.objects.new(name, mesh)
        collection.objects.link(obj)
        add_display(obj, gaussians.sh_degree)
        if gaussians.antialiased:
            obj[ANTIALIASED_KEY] = True
            set_display_input(obj, ANTIALIASED, True)
        return cls(obj.name)

    @classmethod
    def of(cls, obj: bpy.types.Object) -> SplatScene:
        """Return `obj` as a splat scene.

        Raises
        ------
        ObjectError
            When `obj` contains no Gaussians.
        """
        scene = cls(obj.name)
        if not cls.is_splats(obj):
            raise ObjectError(f"{obj.name} contains no Gaussians. Select an imported Gaussian scene or object.")
        return scene

    @staticmethod
    def is_splats(obj: bpy.types.Object | None) -> bool:
        """Return whether `obj` contains Gaussians."""
        if obj is None or obj.type != "MESH":
            return False
        return all(name in obj.data.attributes for name in ("rotation", "scale", "radiance:base"))

    def replace(self, gaussians: Gaussians, *, index: NDArray[np.integer], membership: Float32) -> None:
        """Replace the Gaussians. The object keeps its placement, frame, collections and display.

        Parameters
        ----------
        gaussians : Gaussians
            Gaussians in the frame of the object.
        index, membership
            See `create`.

        Raises
        ------
        ObjectError
            When the object is in Edit Mode, in which its mesh cannot be changed.
        """
        mesh = self._editable_mesh()
        frame = frame_of_mesh(mesh)
        mesh.clear_geometry()
        number = _fill(mesh, gaussians, index, membership)
        keep_frame(mesh, frame, number)

    def set_membership(self, membership: Float32) -> None:
        """Set the membership of each Gaussian, shape [N]. Those below the threshold are not drawn.

        Raises
        ------
        ObjectError
            When the object is in Edit Mode, in which its mesh cannot be changed.
        """
        mesh = self._editable_mesh()
        write_attribute(mesh, "membership", "FLOAT", membership)
        mesh.update_tag()

    def _editable_mesh(self) -> bpy.types.Mesh:
        obj = self.object
        if obj.mode == "EDIT":
            raise ObjectError(f"{obj.name} is in Edit Mode. Leave it first (Tab).")
        return obj.data

    @property
    def object(self) -> bpy.types.Object:
        """The Blender object.

        Raises
        ------
        ObjectError
            When it was deleted or renamed.
        """
        obj = bpy.data.objects.get(self.name)
        if obj is None:
            raise ObjectError(f"The object {self.name} is no longer in this file. Import it again.")
        return obj

    def index(self, count: int) -> NDArray[np.int32]:
        """Return the row of each Gaussian in the project's scene of `count`, shape [N]; -1 for those added by hand.

        Raises
        ------
        ObjectError
            When the rows are not those of such a scene.
        """
        with self._readable_mesh() as mesh:
            none = np.full(len(mesh.vertices), -1, np.int32)
            values = _known(mesh, "gaussian_index", "INT") if "gaussian_index" in mesh.attributes else none
        if len(values) and (values.min() < -1 or values.max() >= count):
            raise ObjectError(f"The Gaussians of {self.name} do not belong to its scene. Import the object again.")
        return values

    @property
    def membership(self) -> Float32 | None:
        """Membership of each Gaussian in the object, shape [N]; None for a whole scene."""
        with self._readable_mesh() as mesh:
            return _known(mesh, "membership", "FLOAT") if "membership" in mesh.attributes else None

    @property
    def shown(self) -> NDArray[np.bool_]:
        """Whether the object shows each Gaussian at its threshold, shape [N]."""
        membership = self.membership
        if membership is None:
            return np.ones(len(self.attribute("scale")), bool)
        return membership >= np.float32(self.object.heritage.threshold)

    def local_gaussians(self, *, harmonics: bool = True) -> Gaussians:
        """Return all Gaussians in the frame of the object, including edits in Edit Mode.

        Without `harmonics`, their colours are the same from all sides. Most of the time of reading is that of them.
        """
        with self._readable_mesh() as mesh:
            base = _read(mesh, "radiance:base")
            bands = number_of_harmonics(mesh, self.name) if harmonics else 0
            sh = np.empty((len(base), 1 + bands, 3), dtype=np.float32)
            sh[:, 0] = base[:, :3]
            for k in range(bands):
                sh[:, k + 1] = _read(mesh, f"radiance:sh_{k}")
            scale = _read(mesh, "scale")
            gaussians = Gaussians(
                means=_read(mesh, "position"),
                log_scales=np.log(np.maximum(scale, np.finfo(np.float32).tiny)),
                quats=_read(mesh, "rotation"),
                opacity_logits=logits_of(base[:, 3]),
                sh=sh,
                antialiased=self.is_antialiased,
            )
            gaussians = with_stored_values(mesh, gaussians, scale, base[:, 3])
            for linear, rows in moves_since(mesh) or ():
                gaussians = _with_rows(gaussians, rows, _turned(gaussians[rows], linear))
            return gaussians

    def follow_vertices(self) -> bool:
        """Put sizes, rotations and colours right after vertices were moved without them; see `moved_vertices`.

        Returns
        -------
        bool
            Whether something was changed. Nothing is changed in Edit Mode, or in a mesh of another file.
        """
        obj = self.object
        mesh = obj.data
        if obj.mode == "EDIT" or mesh.is_editmode or mesh.library is not None:
            return False
        moves = moves_since(mesh)
        if moves is None:
            if "heritage_made_as" not in mesh.attributes:
                mark_as_right(mesh, _new_number())
            return False
        follow_frame(mesh)
        if moves:
            gaussians = self.local_gaussians()
            rows = np.concatenate([rows for _, rows in moves])
            _overwrite(mesh, "rotation", unit_quats(gaussians.quats.astype(np.float64)), rows)
            _overwrite(mesh, "scale", gaussians.scales, rows)
            for k in range(1, gaussians.sh.shape[1]):
                _overwrite(mesh, f"radiance:sh_{k - 1}", gaussians.sh[:, k], rows)
            forget_lost_digits(mesh, rows)
        mark_as_right(mesh)
        mesh.update_tag()
        return bool(moves)

    @property
    def frame(self) -> NDArray[np.float64]:
        """Matrix [4, 4] from the normalised world of the project to the frame of the object.

        Raises
        ------
        ObjectError
            When it was changed or removed by another program.
        """
        with self._readable_mesh() as mesh:
            return frame_of_mesh(mesh)

    @property
    def is_antialiased(self) -> bool:
        """Whether the Gaussians were trained anti-aliased, and are drawn so."""
        return self.object.get(ANTIALIASED_KEY) in (True, 1)

    @property
    def stored_file(self) -> StoredFile | None:
        """The numbers and properties kept of the file that the object was imported from."""
        with self._readable_mesh() as mesh:
            return stored_file(self.object, mesh)

    def attribute(self, name: str) -> Float32:
        """Return the values of an attribute of `Gaussians` in Blender, such as ``"scale"``, shape [N, 3] or [N, 4].

        Raises
        ------
        ObjectError
            When it is missing or was changed to another type.
        """
        with self._readable_mesh() as mesh:
            return _read(mesh, name)

    def attributes(self) -> dict[str, Float32]:
        """Return the values of all attributes that are drawn, by name; see `attribute`."""
        with self._readable_mesh() as mesh:
            names = ["position", "scale", "rotation", "radiance:base"]
            names += [f"radiance:sh_{k}" for k in range(number_of_harmonics(mesh, self.name))]
            return {name: _read(mesh, name) for name in names}

    @property
    def sh_degree(self) -> int:
        """Degree of the spherical harmonics, 0 to 3."""
        with self._readable_mesh() as mesh:
            return HARMONICS.index(number_of_harmonics(mesh, self.name))

    def gaussians(self, threshold: float | None = None) -> Gaussians:
        """Return the Gaussians in world space, with positions, rotations, sizes and view-dependent colours transformed.

        Parameters
        ----------
        threshold : float, optional
            Omit Gaussians with a lower membership.
        """
        gaussians = self.local_gaussians()
        membership = self.membership
        if threshold is not None and membership is not None:
            gaussians = gaussians[membership >= np.float32(threshold)]
        return transform_gaussians(gaussians, world_matrix(self.object))

    @contextlib.contextmanager
    def _readable_mesh(self) -> Iterator[bpy.types.Mesh]:
        """Yield the mesh. In Edit Mode, where attributes cannot be read, yield a copy of its current state."""
        obj = self.object
        if obj.mode != "EDIT":
            yield obj.data
            return
        # The mesh itself is not brought up to date: Blender would tell of that as of a change.
        copy = obj.data.copy()
        try:
            bmesh.from_edit_mesh(obj.data).to_mesh(copy)
            yield copy
        finally:
            bpy.data.meshes.remove(copy)


def _fill(mesh: bpy.types.Mesh, gaussians: Gaussians, index: NDArray[np.integer], membership: Float32 | None) -> int:
    """Write Gaussians into an empty mesh, and return the number that marks its vertices."""
    mesh.vertices.add(len(gaussians))
    if len(gaussians):  # a mesh without vertices has no positions
        write_attribute(mesh, "position", "FLOAT_VECTOR", gaussians.means)
    write_attribute(mesh, "rotation", "QUATERNION", unit_quats(gaussians.quats.astype(np.float64)))
    write_attribute(mesh, "scale", "FLOAT_VECTOR", gaussians.scales)
    base = np.concatenate([gaussians.sh[:, 0], gaussians.opacities[:, None]], axis=1)
    write_attribute(mesh, "radiance:base", FOUR_FLOATS, base)
    for k in range(1, gaussians.sh.shape[1]):
        write_attribute(mesh, f"radiance:sh_{k - 1}", "FLOAT_VECTOR", gaussians.sh[:, k])
    write_attribute(mesh, "gaussian_index", "INT", index)
    if membership is not None:
        write_attribute(mesh, "membership", "FLOAT", membership)
    number = _new_number()
    mark_as_right(mesh, number)
    # The display computes the attribute; the mode Solid draws the one that has this name.
    mesh.attributes.active_color_name = COLOR_ATTRIBUTE
    return number


def _new_number() -> int:
    return 1 + secrets.randbelow(2**31 - 1)


def _turned(gaussians: Gaussians, linear: NDArray[np.float64]) -> Gaussians:
    """Return Gaussians that were moved by a map with their vertices, at the positions that they have already."""
    matrix = np.eye(4)
    matrix[:3, :3] = linear
    return replace(transform_gaussians(gaussians, matrix), means=gaussians.means)


def _with_rows(gaussians: Gaussians, rows: NDArray[np.intp], values: Gaussians) -> Gaussians:
    log_scales, quats, sh = gaussians.log_scales.copy(), gaussians.quats.copy(), gaussians.sh.copy()
    log_scales[rows], quats[rows], sh[rows] = values.log_scales, values.quats, values.sh
    return replace(gaussians, log_scales=log_scales, quats=quats, sh=sh)


def _overwrite(mesh: bpy.types.Mesh, name: str, values: NDArray[np.floating], rows: NDArray[np.intp]) -> None:
    all_values = _read(mesh, name)
    all_values[rows] = values[rows]
    write_attribute(mesh, name, mesh.attributes[name].data_type, all_values)


def _read(mesh: bpy.types.Mesh, name: str) -> Float32:
    if name not in mesh.attributes and not len(mesh.vertices):
        return np.zeros((0, 4 if name == "radiance:base" else 3), np.float32)
    return _known(mesh, name, *VECTORS)


def _known(mesh: bpy.types.Mesh, name: str, *kinds: str) -> NDArray[Any]:
    values = read_attribute(mesh, name, *kinds)
    if values is None:
        raise ObjectError(f"The attribute {name} of {mesh.name} was changed to another type. Import the object again.")
    return values
