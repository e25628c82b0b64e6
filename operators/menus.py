"""The menu *Object > Gaussian Heritage*, in which F3 finds what the panels do with objects."""

from __future__ import annotations

import bpy


class HERITAGE_MT_objects(bpy.types.Menu):
    """Actions on the objects of a Gaussian scene."""

    bl_idname = "HERITAGE_MT_objects"
    bl_label = "Gaussian Heritage"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the menu."""
        layout = self.layout
        # Its dialog asks for the words; another choice would run it at once.
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("heritage.isolate", icon="VIEWZOOM")
        layout.operator("heritage.click_object", icon="EYEDROPPER")
        layout.operator("heritage.find_objects")
        layout.operator("heritage.isolate_background")
        layout.separator()
        layout.operator("heritage.click_object", text="Correct by Clicks").refine = True
        layout.operator("heritage.add_detail").every = False
        layout.operator("heritage.make_mesh").watertight = False
        layout.operator("heritage.solo_object")
        layout.operator("heritage.merge_objects", text="Merge Selected")
        layout.operator("heritage.store_edits")
        layout.separator()
        layout.operator("heritage.export_objects", text="Export Objects")


def object_menu(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Draw the entry of Blender's menu *Object*."""
    menu.layout.separator()
    menu.layout.menu("HERITAGE_MT_objects")


CLASSES = [HERITAGE_MT_objects]
