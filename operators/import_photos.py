"""File > Import > Photo Folder as Gaussian Scene."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..engine.errors import HeritageError, PhotoError
from ..gaussian_heritage_addon import job_runner
from ..gaussian_heritage_addon.project import default_project_folder

__all__ = ["CLASSES"]


def _presets(operator: bpy.types.Operator, context: bpy.types.Context, typed: str) -> list[str]:
    return ["preview", "standard", "best"]


class HERITAGE_OT_import_photo_folder(bpy.types.Operator):
    """Turn a folder of photos into a Gaussian scene; an earlier run is continued"""

    bl_idname = "heritage.import_photo_folder"
    bl_label = "Import Photo Folder"
    bl_options = {"REGISTER", "UNDO"}

    directory: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Photos", description="Folder with the photos", subtype="DIR_PATH"
    )
    project: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Project", description="Where to work; empty: beside the photos", subtype="DIR_PATH", options={"SKIP_SAVE"}
    )
    prompts: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Objects", description='What to isolate at the end, e.g. "vase;bust"', options={"SKIP_SAVE"}
    )
    cameras: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Cameras",
        description="COLMAP model or transforms.json to use instead of estimating the cameras",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
    )
    # Text, not a fixed list: the engine knows its presets and says so when a name is wrong.
    preset: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Preset",
        description="How much work: preview, standard or best",
        default="standard",
        search=_presets,
    )
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN"})  # type: ignore[valid-type]
    filter_image: bpy.props.BoolProperty(default=True, options={"HIDDEN"})  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for the folder."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the engine; the result is imported when it is done."""
        try:
            photos = Path(bpy.path.abspath(self.directory))
            if not self.directory or not photos.is_dir():
                raise PhotoError(f"{self.directory or 'Nothing'} is not a folder of photos. Choose one.")
            project = Path(bpy.path.abspath(self.project)) if self.project else default_project_folder(photos)
            arguments = ["reconstruct", str(photos), "--out", str(project), "--preset", self.preset]
            arguments += ["--prompts", self.prompts] if self.prompts.strip() else []
            arguments += ["--cameras", bpy.path.abspath(self.cameras)] if self.cameras else []
            state = job_runner.start("reconstruct", project, *arguments)
        except HeritageError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, "Working in the background; see the Heritage panel." if state is None else state.message)
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_import_photo_folder]
