"""The operators: one module per action of the user. A module with a list CLASSES is found and registered by itself."""

import importlib
import pkgutil

import bpy

from ..engine.formats import READ_SUFFIXES
from ..gaussian_heritage_addon.blender import guards
from ..gaussian_heritage_addon.language.translations import translated
from . import menus, shortcuts

_MODULES = [importlib.import_module(f".{found.name}", __name__) for found in pkgutil.iter_modules(__path__)]
CLASSES = [cls for module in _MODULES for cls in getattr(module, "CLASSES", ())]


def _import_menu(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    menu.layout.operator("heritage.import_photo_folder", text="Photo Folder as Gaussian Scene")
    suffixes = "/".join(suffix for suffix in READ_SUFFIXES if suffix != ".json")
    menu.layout.operator("heritage.import_gaussian_ply", text=translated("Gaussian Scene ({})", suffixes))
    menu.layout.operator("heritage.open_project", text="Gaussian Heritage Project")


def _export_menu(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    menu.layout.operator("heritage.export_objects", text="Gaussian Objects and Meshes (.glb/.ply/...)")
    menu.layout.operator("heritage.export_splats", text="Gaussian Splats, One File (.glb/.ply/...)")


def register() -> None:
    """Add the operators to Blender and to its File menu."""
    for cls in CLASSES:
        guards.register_class(cls)
    guards.add_menu_entry(bpy.types.TOPBAR_MT_file_import, _import_menu)
    guards.add_menu_entry(bpy.types.TOPBAR_MT_file_export, _export_menu)
    guards.add_menu_entry(bpy.types.VIEW3D_MT_object, menus.object_menu)
    shortcuts.register()
