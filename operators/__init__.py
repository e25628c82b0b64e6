"""The operators: one module per action of the user."""

import bpy

from ..gaussian_heritage_addon.blender import guards
from . import (
    accept_candidate,
    cancel_job,
    check_engine,
    check_models,
    click_object,
    continue_job,
    copy_as_native,
    dismiss_candidates,
    drop_job,
    edit_objects,
    edit_region,
    export_objects,
    fetch_model,
    find_objects,
    import_photos,
    import_ply,
    improve_scene,
    isolate,
    isolate_background,
    look_through_photo,
    measure_scene,
    menus,
    open_project,
    open_result,
    pick_object,
    refine_object,
    remove_default_objects,
    remove_engine,
    render_settings,
    select_object,
    select_splats,
    set_up_engine,
    shortcuts,
    show_project,
    solo_object,
)

__all__ = ["CLASSES", "register", "unregister"]

_MODULES = (
    import_photos,
    import_ply,
    open_project,
    improve_scene,
    isolate,
    click_object,
    pick_object,
    find_objects,
    isolate_background,
    accept_candidate,
    dismiss_candidates,
    select_object,
    refine_object,
    select_splats,
    edit_region,
    edit_objects,
    measure_scene,
    export_objects,
    look_through_photo,
    set_up_engine,
    check_engine,
    remove_engine,
    check_models,
    fetch_model,
    cancel_job,
    continue_job,
    drop_job,
    open_result,
    show_project,
    remove_default_objects,
    solo_object,
    copy_as_native,
    render_settings,
    menus,
)
CLASSES = [cls for module in _MODULES for cls in module.CLASSES]


def _import_menu(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    menu.layout.operator("heritage.import_photo_folder", text="Photo Folder as Gaussian Scene")
    menu.layout.operator("heritage.import_gaussian_ply", text="Gaussian Scene (.ply/.spz/.sog/.splat/.ksplat/.glb)")
    menu.layout.operator("heritage.open_project", text="Gaussian Heritage Project")


def _export_menu(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    menu.layout.operator("heritage.export_objects", text="Gaussian Objects (.glb/.ply/...)")
    menu.layout.operator("heritage.export_splats", text="Gaussian Splats, One File (.glb/.ply/...)")


def register() -> None:
    """Add the operators to Blender and to its File menu."""
    for cls in CLASSES:
        guards.register_class(cls)
    guards.add_menu_entry(bpy.types.TOPBAR_MT_file_import, _import_menu)
    guards.add_menu_entry(bpy.types.TOPBAR_MT_file_export, _export_menu)
    guards.add_menu_entry(bpy.types.VIEW3D_MT_object, menus.object_menu)
    shortcuts.register()


def unregister() -> None:
    """Remove them from Blender."""
    shortcuts.unregister()
    guards.remove_menu_entry(bpy.types.VIEW3D_MT_object, menus.object_menu)
    guards.remove_menu_entry(bpy.types.TOPBAR_MT_file_export, _export_menu)
    guards.remove_menu_entry(bpy.types.TOPBAR_MT_file_import, _import_menu)
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
