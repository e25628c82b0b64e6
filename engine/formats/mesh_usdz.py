"""Meshes as USDZ: a text layer of USD and its texture in one uncompressed zip file. No OpenUSD is needed."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..core.files import write_file
from ..core.visible_text import visible
from ..scene import Mesh
from .facts import FileFacts
from .mesh_glb import MESH_ROUGHNESS
from .mesh_plain import FILLED_MATERIAL, SEEN_MATERIAL

_ALIGNMENT = 64
"""Bytes of which the data of each file in a USDZ begins at a multiple, by its specification."""

_LAYER, _TEXTURE = "mesh.usda", "textures/base_color.png"
_DATE = (1980, 1, 1, 0, 0, 0)


def write_mesh_usdz(path: Path, mesh: Mesh, facts: FileFacts, texture: bytes) -> None:
    """Write a mesh as USDZ, atomically.

    Parameters
    ----------
    mesh : Mesh
        Z up.
    facts : FileFacts
        ``metres_per_unit`` of None is said in the layer, which states 1 then, as for Gaussians.
    texture : bytes
        As PNG.

    Raises
    ------
    DiskError
        When the file cannot be written.
    """
    files = {_LAYER: _layer(mesh, facts).encode(), _TEXTURE: texture}
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w", zipfile.ZIP_STORED) as archive:
        for file, data in files.items():
            entry = zipfile.ZipInfo(file, _DATE)
            # A field that readers skip moves the data to a multiple of 64 bytes.
            begin = whole.tell() + 30 + len(file)
            gap = -(begin + 4) % _ALIGNMENT
            entry.extra = b"\x19\x86" + gap.to_bytes(2, "little") + b"\0" * gap
            archive.writestr(entry, data)
    write_file(path, whole.getbuffer())


def _layer(mesh: Mesh, facts: FileFacts) -> str:
    unit = facts.metres_per_unit
    data = {"generator": f"Gaussian Heritage {__version__}"}
    data |= {} if unit is not None else {"unit": "unknown"}
    # One text: keys of records are no identifiers of USD.
    data |= {"record": json.dumps(dict(facts.extras), ensure_ascii=False)} if facts.extras else {}
    lines = "".join(f"        string {key} = {_text(value)}\n" for key, value in data.items())
    corners = mesh.vertices[mesh.corners]
    extent = np.stack([corners.min(axis=0), corners.max(axis=0)])
    seen = mesh.seen_vertices[mesh.corners].astype(int)
    subsets = "".join(
        f"""
        def GeomSubset "{material}" (
            prepend apiSchemas = ["MaterialBindingAPI"]
        )
        {{
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [{", ".join(map(str, np.flatnonzero(shown).tolist()))}]
            rel material:binding = </Object/Materials/{material}>
        }}
"""
        for material, shown in ((SEEN_MATERIAL, mesh.seen), (FILLED_MATERIAL, ~mesh.seen))
        if shown.any()
    )
    return f"""#usda 1.0
(
    customLayerData = {{
{lines}    }}
    defaultPrim = "Object"
    metersPerUnit = {1.0 if unit is None else unit!r}
    upAxis = "Z"
)

def Xform "Object" (
    displayName = {_text(facts.name)}
    kind = "component"
)
{{
    def Mesh "Mesh" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {{
        uniform bool doubleSided = 1
        uniform token subdivisionScheme = "none"
        float3[] extent = {_tuples(extent)}
        int[] faceVertexCounts = [{", ".join(["3"] * len(mesh.faces))}]
        int[] faceVertexIndices = [{", ".join(map(str, mesh.texture_faces.ravel().tolist()))}]
        point3f[] points = {_tuples(corners)}
        normal3f[] normals = {_tuples(mesh.normals[mesh.corners])} (
            interpolation = "vertex"
        )
        texCoord2f[] primvars:st = {_tuples(mesh.uv)} (
            interpolation = "vertex"
        )
        int[] primvars:seen = [{", ".join(map(str, seen.tolist()))}] (
            interpolation = "vertex"
        )
{subsets}    }}

    def Scope "Materials"
    {{{_material(SEEN_MATERIAL)}{_material(FILLED_MATERIAL)}    }}
}}
"""


def _material(name: str) -> str:
    place = f"/Object/Materials/{name}"
    return f"""
        def Material "{name}"
        {{
            token outputs:surface.connect = <{place}/Surface.outputs:surface>

            def Shader "Surface"
            {{
                uniform token info:id = "UsdPreviewSurface"
                color3f inputs:diffuseColor.connect = <{place}/Texture.outputs:rgb>
                float inputs:metallic = 0
                float inputs:roughness = {MESH_ROUGHNESS}
                token outputs:surface
            }}

            def Shader "Texture"
            {{
                uniform token info:id = "UsdUVTexture"
                asset inputs:file = @{_TEXTURE}@
                token inputs:sourceColorSpace = "sRGB"
                float2 inputs:st.connect = <{place}/Places.outputs:result>
                float3 outputs:rgb
            }}

            def Shader "Places"
            {{
                uniform token info:id = "UsdPrimvarReader_float2"
                string inputs:varname = "st"
                float2 outputs:result
            }}
        }}
"""


def _tuples(rows: NDArray[np.floating]) -> str:
    return "[" + ", ".join(f"({', '.join(f'{value:.7g}' for value in row)})" for row in rows.tolist()) + "]"


def _text(text: str) -> str:
    """Return a text as USD writes it, in one line."""
    return '"' + visible(text).replace("\\", "\\\\").replace('"', '\\"') + '"'
