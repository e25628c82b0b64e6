"""File > Import > Gaussian Heritage Project: open the project folder of an earlier import."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import BoolProperty, StringProperty

from ..engine.core.errors import ProjectError
from ..engine.project.content import scene_file
from ..gaussian_heritage_addon.blender import problems
from ..gaussian_heritage_addon.blender.typed_properties import blender_properties
from ..gaussian_heritage_addon.jobs.results import scene_for
from ..gaussian_heritage_addon.project import open_projects
from ..gaussian_heritage_addon.project.first_view import show_scene
from ..gaussian_heritage_addon.project.moved_projects import is_missing, relink, relink_scene_of
from ..gaussian_heritage_addon.project.project_history import look_again
from ..gaussian_heritage_addon.project.scene_file import open_project
from ..gaussian_heritage_addon.splats.properties import project_of


@blender_properties
class _ProjectFolderOperator(bpy.types.Operator):
    """Asks for the folder of a project."""

    bl_options = {"REGISTER", "UNDO"}

    directory: str = StringProperty(name="Project", subtype="DIR_PATH")
    filter_folder: bool = BoolProperty(default=True, options={"HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Open the file browser to select the folder."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def _project(self) -> Path:
        """Return the selected folder, which holds a project; raise what `scene_file` raises."""
        project = Path(bpy.path.abspath(self.directory)).absolute()
        scene_file(project)
        return project


@blender_properties
class HERITAGE_OT_open_project(_ProjectFolderOperator):
    """Add a project folder to this file: its scene, cameras and objects. Each project has a scene of its own"""

    bl_idname = "heritage.open_project"
    bl_label = "Open Project"

    with_cameras: bool = BoolProperty(name="Cameras", description="Add a camera for each photo", default=True)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Import the project."""
        project = self._project()
        relink_scene_of(project)
        scene = scene_for(project)
        if context.window is not None:
            context.window.scene = scene
        open_project(scene, project, with_cameras=self.with_cameras)
        look_again()
        show_scene(scene)
        open_projects.update()
        if open_projects.is_open_elsewhere(project):
            self.report(
                {"WARNING"}, f"Another Blender has {project.name} open. Close one of them before you store edits."
            )
        return {"FINISHED"}


class HERITAGE_OT_find_project(_ProjectFolderOperator):
    """Choose where the missing project of this scene is now. The scene and its objects stay as they are"""

    bl_idname = "heritage.find_project"
    bl_label = "Find Project"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Relink the scene and its objects."""
        project = self._project()
        if not is_missing(context.scene.heritage):
            raise ProjectError("No project of this scene is missing. Use Open Project for another one.")
        relink(project_of(context.scene.heritage), project)
        look_again()
        problems.clear()
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_open_project, HERITAGE_OT_find_project]
