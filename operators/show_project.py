"""Show the folder of the project in the system's file browser, or its report in the web browser.

Blender does not say where it found no such program, so the place is always said.
"""

from __future__ import annotations

import bpy

from ..engine.core.errors import ProjectError
from ..engine.project.content import is_project, readable_report
from ..gaussian_heritage_addon.language.translations import language, translated
from ..gaussian_heritage_addon.splats.properties import project_of


class HERITAGE_OT_show_folder(bpy.types.Operator):
    """Show the folder of the project in the system's file browser"""

    bl_idname = "heritage.show_folder"
    bl_label = "Show Folder"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Show the folder."""
        project = project_of(context.scene.heritage)
        if not is_project(project):
            raise ProjectError(f"{project} is not a Gaussian Heritage project. Open another one.")
        bpy.ops.wm.path_open(filepath=str(project))
        self.report({"INFO"}, translated("The project is in {}", project))
        return {"FINISHED"}


class HERITAGE_OT_open_report(bpy.types.Operator):
    """Open the report of the reconstruction in the web browser: errors, run times, and what was left out"""

    bl_idname = "heritage.open_report"
    bl_label = "Open Report"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Open the report."""
        report = readable_report(project_of(context.scene.heritage), language().code)
        if not report.is_file():
            raise ProjectError(f"{report} does not exist. Import the photo folder again to make it.")
        bpy.ops.wm.url_open(url=report.as_uri())
        self.report({"INFO"}, translated("The report is {}", report))
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_show_folder, HERITAGE_OT_open_report]
