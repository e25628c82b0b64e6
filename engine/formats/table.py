"""The formats of Gaussians: what each is called, its files, and what reads and writes them. Nothing else lists them.

A new format is a module with its reader or writer, and a row in `FORMATS`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..core.errors import SettingsError
from ..scene import Gaussians, Mesh
from .axes import Up
from .facts import FileFacts
from .glb import read_glb, write_glb
from .ksplat import read_ksplat
from .mesh_glb import write_mesh_glb
from .mesh_plain import write_mesh_obj, write_mesh_ply, write_mesh_stl
from .mesh_usdz import write_mesh_usdz
from .ply import read_ply, write_ply
from .sog import DecodePicture, read_sog
from .sog_writing import EncodePicture, write_sog
from .splat import read_splat
from .spz import read_spz, write_spz
from .usd import write_usd


@dataclass(frozen=True)
class WritingTools:
    """What writers need of the program that calls them.

    Attributes
    ----------
    encode_picture : callable
        See `EncodePicture`.
    write_usd : callable
        `write_usd`, or a function with its parameters for a program whose Python has no OpenUSD.
    """

    encode_picture: EncodePicture
    write_usd: Callable[[Path, Gaussians, FileFacts], None] = write_usd


Write = Callable[[Path, Gaussians, FileFacts, WritingTools], None]
WriteMesh = Callable[[Path, Mesh, FileFacts, bytes], None]
Read = Callable[[Path, DecodePicture, Up | None], Gaussians]


@dataclass(frozen=True)
class Format:
    """A format of files with Gaussians, or with a mesh.

    Attributes
    ----------
    name : str
        As the command line and the server call it.
    label : str
        As menus and buttons call it.
    suffixes : tuple of str
        Ends of the names of its files. The first is that of the files that are written.
    media_type : str
    description : str
        One sentence, without its full stop, that says what the format is for.
    write : callable, optional
        Writes a file from Gaussians, `FileFacts` and `WritingTools`; None: not written, or a page.
    write_mesh : callable, optional
        Writes a mesh that is in the world of the file, `FileFacts`, and its texture as PNG; None: no format of meshes.
    mesh_up : {"z", "-y", "y"}
        Axis that points up in files with a mesh.
    defines_up : bool
        Whether the format itself says which axis that is, so that a mesh is turned to it in any case.
    shows_texture : bool
        Whether its files hold the texture of a mesh.
    ignores_alpha : bool
        Whether it says that the alpha of a texture is not drawn, so that alpha can mark what no photo saw.
    beside : tuple of str
        Ends of the names of further files that are written beside a mesh.
    read : callable, optional
        Returns the Gaussians in the engine's world (Z up) from a path, the decoder of pictures, and the axis that
        points up (None: what the file or its format says).
    starts : tuple of bytes
        First bytes of its files, by which they are recognised; without any, their name is what counts.
    read_suffixes : tuple of str
        Ends of the names of further files that are read.
    carries_record : bool
        Whether its files hold the record.
    carries_seen : bool
        Whether its files hold the number of photos that saw each Gaussian.
    needs_openusd : bool
    is_page : bool
        Whether it is a page for a browser, which `engine.delivery.packages` writes from the Gaussians, the record and
        the parts.
    is_packed : bool
        Whether its files are compressed already, or would hardly shrink in a zip file.
    package_note : str
        What a package says of its file in this format; empty: packages have none.
    """

    name: str
    label: str
    suffixes: tuple[str, ...]
    media_type: str
    description: str
    write: Write | None = None
    write_mesh: WriteMesh | None = None
    mesh_up: Up = "z"
    defines_up: bool = False
    shows_texture: bool = False
    ignores_alpha: bool = False
    beside: tuple[str, ...] = ()
    read: Read | None = None
    starts: tuple[bytes, ...] = ()
    read_suffixes: tuple[str, ...] = ()
    carries_record: bool = True
    carries_seen: bool = False
    needs_openusd: bool = False
    is_page: bool = False
    is_packed: bool = False
    package_note: str = ""


def _write_ply(path: Path, gaussians: Gaussians, facts: FileFacts, tools: WritingTools) -> None:
    seen = {} if facts.seen is None else {"photos_seen": facts.seen}
    write_ply(
        path,
        gaussians,
        comments=facts.comments,
        up=facts.header_up if facts.header else facts.up,
        matrix=facts.matrix,
        extra={**facts.properties, **seen},
        header=facts.header,
        lost=facts.lost,
    )


FORMATS: tuple[Format, ...] = (
    Format(
        "ply", "PLY", (".ply",), "application/x-ply",
        "Standard file of 3D Gaussian splatting, -Y up as its viewers expect",
        _write_ply, read=lambda path, decode, up: read_ply(path), starts=(b"ply",),
        carries_seen=True,
        package_note="the Gaussians in the layout of 3D Gaussian splatting (PLY), Y down as its viewers expect",
    ),
    Format(
        "spz", "SPZ", (".spz",), "application/octet-stream",
        "Compressed to a sixth of the size, with some loss and without a record",
        lambda path, gaussians, facts, tools: write_spz(path, gaussians, facts),
        read=lambda path, decode, up: read_spz(path, up=up), starts=(b"\x1f\x8b", b"NGSP"),
        carries_record=False, is_packed=True,
        package_note="the same in a sixth of the size, with rounded values (SPZ)",
    ),
    Format(
        "glb", "GLB", (".glb",), "model/gltf-binary",
        "Recommended: binary glTF with KHR_gaussian_splatting and the record, upright in every program",
        lambda path, gaussians, facts, tools: write_glb(path, gaussians, facts),
        read=lambda path, decode, up: read_glb(path), starts=(b"glTF",),
        carries_seen=True, is_packed=True,
        package_note="the same as glTF with the extension KHR_gaussian_splatting, Y up",
    ),
    # .json is the description of a SOG that is not zipped.
    Format(
        "sog", "SOG", (".sog",), "application/zip",
        "For the web, up to a twentieth of the size, with some loss, -Y up as its viewers expect",
        lambda path, gaussians, facts, tools: write_sog(path, gaussians, tools.encode_picture, facts),
        read=lambda path, decode, up: read_sog(path, decode, up=up), starts=(b"PK", b"{"),
        read_suffixes=(".json",),
        is_packed=True,
    ),
    # USD is read by the engine alone: `read_usd`.
    Format(
        "usd", "USD", (".usd", ".usdc", ".usda"), "model/vnd.usd",
        "OpenUSD 26.03 or newer, ParticleField3DGaussianSplat, Z up",
        lambda path, gaussians, facts, tools: tools.write_usd(path, gaussians, facts),
        carries_seen=True, needs_openusd=True,
    ),
    Format(
        "html", "page", (".html",), "text/html",
        "One file with a viewer and the record, which a browser opens without the web",
        is_page=True, package_note="a page that shows it; open it in a browser",
    ),
    Format(
        "mesh", "mesh, PLY", (".ply",), "application/x-ply",
        "Mesh of an object with coloured vertices, and which of them no photo saw, Z up",
        write_mesh=write_mesh_ply,
    ),
    Format(
        "glb-mesh", "mesh, GLB", (".glb",), "model/gltf-binary",
        "Recommended for meshes: textured mesh of an object with the record, upright in every program",
        write_mesh=write_mesh_glb, mesh_up="y", defines_up=True, shows_texture=True, ignores_alpha=True,
        is_packed=True,
    ),
    Format(
        "obj", "mesh, OBJ", (".obj",), "model/obj",
        "Textured mesh of an object for older programs, with its .mtl and .png beside it, Y up",
        write_mesh=write_mesh_obj, mesh_up="y", shows_texture=True, beside=(".mtl", ".png"),
    ),
    Format(
        "stl", "mesh, STL", (".stl",), "model/stl",
        "Mesh of an object for printing, in millimetres where the scale is known, without colours, Z up",
        write_mesh=write_mesh_stl, carries_record=False,
    ),
    Format(
        "usd-mesh", "mesh, USDZ", (".usdz",), "model/vnd.usdz+zip",
        "Textured mesh of an object with the record in one file, Z up",
        write_mesh=write_mesh_usdz, shows_texture=True, is_packed=True,
    ),
    Format(
        "splat", "SPLAT", (".splat",), "application/octet-stream", "Of viewers for the web, 32 bytes for each Gaussian",
        read=lambda path, decode, up: read_splat(path, up=up), carries_record=False,
    ),
    Format(
        "ksplat", "KSPLAT", (".ksplat",), "application/octet-stream", "Of the viewer GaussianSplats3D",
        read=lambda path, decode, up: read_ksplat(path, up=up), carries_record=False,
    ),
)  # fmt: skip
"""All formats, in the order in which they are offered."""
DEFAULT_FORMAT = "glb"
"""What is recommended: other programs show it upright, and it holds the record."""


def format_of(name: str) -> Format:
    """Return the format called `name`.

    Raises
    ------
    SettingsError
        When there is none.
    """
    found = next((one for one in FORMATS if one.name == name), None)
    if found is None:
        raise SettingsError(f"There is no format {name!r}. Choose one of {', '.join(one.name for one in FORMATS)}.")
    return found


def write_scene(path: Path, gaussians: Gaussians, name: str, facts: FileFacts, tools: WritingTools) -> None:
    """Write `gaussians` in the format called `name`, atomically, replacing an existing file.

    Parameters
    ----------
    gaussians : Gaussians
        In the engine's world (Z up), before the transform of `facts`.
    name : str
        Of a format with a writer.
    facts : FileFacts
        What the format has no place for is left out.

    Raises
    ------
    SettingsError
        When there is no such format, or Gaussians alone do not make a file of it.
    HeritageError
        As the writer of the format: when a value is not finite or too far away, or the file cannot be written.
    """
    write = format_of(name).write
    if write is None:
        writable = ", ".join(one.name for one in FORMATS if one.write is not None)
        raise SettingsError(f"{path} cannot be written in the format {name}. Choose one of {writable}.")
    write(path, gaussians, facts, tools)


def write_mesh(path: Path, mesh: Mesh, name: str, facts: FileFacts, texture: bytes) -> None:
    """Write `mesh` in the format called `name`, atomically, replacing existing files.

    Parameters
    ----------
    mesh : Mesh
        In the engine's world (Z up), before the transform of `facts`.
    name : str
        Of a format of meshes.
    facts : FileFacts
        What the format has no place for is left out. ``up`` of None: the mesh is not turned, but in formats that define
        which axis points up.
    texture : bytes
        The texture of the mesh as PNG.

    Raises
    ------
    SettingsError
        When there is no such format of meshes.
    HeritageError
        As the writer of the format.
    """
    kind = format_of(name)
    if kind.write_mesh is None:
        meshes = ", ".join(one.name for one in FORMATS if one.write_mesh is not None)
        raise SettingsError(f"{path} cannot be written as a mesh in the format {name}. Choose one of {meshes}.")
    turned = facts.transform(kind.mesh_up if facts.up is not None or kind.defines_up else None)
    kind.write_mesh(path, mesh.moved(turned), facts, texture)
