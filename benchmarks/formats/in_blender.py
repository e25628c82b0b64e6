"""Runs in Blender's Python: imports a mesh, and draws it without light by Cycles, once for each camera.

example: python in_blender.py vase.glb '[{"eye": [0, -2, 1], "target": [0, 0, 0], "fov": 40}]' out.png
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import bpy
from mathutils import Matrix, Vector

WIDTH, HEIGHT = 640, 480


def main() -> None:
    """Draw `sys.argv[1]` from the cameras of `sys.argv[2]` into files named like `sys.argv[3]`, with their number."""
    file, looks, out = Path(sys.argv[1]), json.loads(sys.argv[2]), Path(sys.argv[3])
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    load(file)
    for material in bpy.data.materials:
        show_texture(material)
    scene = bpy.context.scene
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    camera.data.sensor_fit, camera.data.clip_start = "VERTICAL", 0.001
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.use_denoising = "CPU", 16, False
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    scene.view_settings.view_transform = "Standard"
    scene.render.image_settings.file_format = "PNG"
    for number, look in enumerate(looks):
        eye, target = Vector(look["eye"]), Vector(look["target"])
        camera.matrix_world = Matrix.Translation(eye) @ (target - eye).to_track_quat("-Z", "Y").to_matrix().to_4x4()
        camera.data.angle = math.radians(look["fov"])
        scene.render.filepath = str(out.with_stem(f"{out.stem}_{number}"))
        bpy.ops.render.render(write_still=True)


def load(file: Path) -> None:
    """Import a mesh with the default options of its importer."""
    if file.suffix == ".glb":
        bpy.ops.preferences.addon_enable(module="io_scene_gltf2")
        bpy.ops.import_scene.gltf(filepath=str(file))
    elif file.suffix == ".obj":
        bpy.ops.wm.obj_import(filepath=str(file))
    else:
        bpy.ops.wm.usd_import(filepath=str(file))


def show_texture(material: bpy.types.Material) -> None:
    """Let a material shine with the colours of its texture alone, as they are."""
    nodes, links = material.node_tree.nodes, material.node_tree.links
    texture = next((node for node in nodes if node.type == "TEX_IMAGE"), None)
    output = next((node for node in nodes if node.type == "OUTPUT_MATERIAL"), None)
    if texture is None or output is None:
        return
    shine = nodes.new("ShaderNodeEmission")
    links.new(texture.outputs["Color"], shine.inputs["Color"])
    links.new(shine.outputs["Emission"], output.inputs["Surface"])


if __name__ == "__main__":
    main()
