"""File > Import > Photo Folder as Gaussian Scene."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import bpy
from bpy.app.translations import pgettext_n
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, StringProperty

from ..engine.core.errors import PhotoError
from ..engine.photos.settings import PHOTO_SUFFIXES, VIDEO_SUFFIXES
from ..engine.project.content import default_project_folder
from ..engine.scene import FISHEYE_LENS
from ..engine.training.settings import DEFAULT_PRESET, LIGHT_DESCRIPTION, LIGHT_LABEL, PRESET_LIST
from ..gaussian_heritage_addon.blender.typed_properties import blender_properties
from ..gaussian_heritage_addon.panels.preset_choice import draw_presets
from .dropped_files import DroppedIntoView
from .project_operator import start_job

_DIALOG_WIDTH = 450
_LABELLED = (
    ("prompts", pgettext_n("vase, teapot; empty: none")),
    ("cameras", pgettext_n("Empty: estimated from the photos")),
    ("masks", pgettext_n("Empty: no masks")),
    ("project", pgettext_n("Empty: beside the photos")),
)
"""Fields below their own labels, with what they show while they are empty."""
_DIALOG_LINE_LENGTH = 65


@blender_properties
class HERITAGE_OT_import_photo_folder(bpy.types.Operator):
    """Turn a folder of photos, or a video, into a Gaussian scene. Resumes an earlier import of the same photos"""

    bl_idname = "heritage.import_photo_folder"
    bl_label = "Import Photo Folder"

    directory: str = StringProperty(name="Photos", description="Folder with the photos", subtype="DIR_PATH")
    filepath: str = StringProperty(
        name="Video",
        description="A video to take the photos from, instead of a folder",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
    )
    files: Sequence[bpy.types.OperatorFileListElement] = CollectionProperty(
        type=bpy.types.OperatorFileListElement,
        name="Files",
        description="Photos that were dropped; all photos of their folder are used",
        options={"HIDDEN", "SKIP_SAVE"},
    )
    project: str = StringProperty(
        name="Project Folder",
        description="Folder that the scene is stored in; empty: create it next to the photo folder",
        subtype="DIR_PATH",
        options={"SKIP_SAVE"},
    )
    prompts: str = StringProperty(
        name="Objects to Isolate",
        description="What is searched for at the end, in English words, separated by commas (vase, teapot)",
        options={"SKIP_SAVE"},
    )
    cameras: str = StringProperty(
        name="Known Cameras",
        description="Known cameras of COLMAP, nerfstudio, Metashape, RealityCapture or Bundler; empty: estimate them",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
    )
    masks: str = StringProperty(
        name="Folder of Masks",
        description="Folder with a mask for each photo, named like it; what is black in them is left out",
        subtype="DIR_PATH",
        options={"SKIP_SAVE"},
    )
    mask_background: bool = BoolProperty(
        name="Leave Out Background",
        description="Leave the background out, for an object on a turntable before a background that stands still",
        default=False,
        options={"SKIP_SAVE"},
    )
    fisheye: bool = BoolProperty(
        name="Fisheye Lens",
        description="The photos are those of a fisheye lens, as of action cameras: straight edges look bent",
        default=False,
        options={"SKIP_SAVE"},
    )
    light: bool = BoolProperty(name=LIGHT_LABEL, description=LIGHT_DESCRIPTION, default=False, options={"SKIP_SAVE"})
    preset: str = EnumProperty(
        name="Preset",
        description="How much work is done, and how good the scene becomes",
        # All that the engine has, for scripts. Only those that are offered are drawn.
        items=[(one.name, one.label, one.description if one.offered else "") for one in PRESET_LIST],
        default=DEFAULT_PRESET,
    )
    filter_folder: bool = BoolProperty(default=True, options={"HIDDEN"})
    filter_image: bool = BoolProperty(default=True, options={"HIDDEN"})
    filter_movie: bool = BoolProperty(default=True, options={"HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Open the file browser to select the folder; for dropped files, ask for the options only."""
        if self.filepath or self.files:
            # Blender gives the folder and the first file of whatever was dropped.
            if Path(self.filepath).suffix.lower() in VIDEO_SUFFIXES:
                self.directory = ""
            else:
                self.filepath = ""
            answer: set[str] = context.window_manager.invoke_props_dialog(self, width=_DIALOG_WIDTH)
            return answer
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the presets with the time that each takes for these photos, and the other options."""
        layout, photos = self.layout, self._shown_photos(context)
        line_length = None if photos is None or context.area.type == "FILE_BROWSER" else _DIALOG_LINE_LENGTH
        draw_presets(layout, self, photos, line_length=line_length)
        layout.prop(self, "light")
        properties = bpy.ops.heritage.import_photo_folder.get_rna_type().properties
        for name, placeholder in _LABELLED:
            column = layout.column(align=True)
            column.label(text=properties[name].name)
            column.prop(self, name, text="", placeholder=placeholder)
        layout.prop(self, "mask_background")
        layout.prop(self, "fisheye")

    def _shown_photos(self, context: bpy.types.Context) -> Path | None:
        """Return the folder that the file browser shows, or what was dropped."""
        space = context.space_data
        if space is not None and space.type == "FILE_BROWSER" and space.params is not None:
            return Path(os.fsdecode(space.params.directory))
        chosen = self.filepath or self.directory
        return Path(bpy.path.abspath(chosen)) if chosen else None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the engine. The result is imported when it has finished."""
        video = Path(bpy.path.abspath(self.filepath)) if self.filepath else None
        photos = Path(bpy.path.abspath(self.directory))
        if video is not None and video.suffix.lower() in VIDEO_SUFFIXES:
            photos = video
            if not video.is_file():
                raise PhotoError(f"There is no video {video}.")
        elif not self.directory or not photos.is_dir():
            raise PhotoError(
                f"{self.directory or 'An empty path'} is not a folder. Choose a folder of photos, or a video."
            )
        project = Path(bpy.path.abspath(self.project)) if self.project else default_project_folder(photos)
        arguments = ["reconstruct", str(photos), "--out", str(project), "--preset", self.preset]
        arguments += ["--light"] if self.light else []
        arguments += ["--prompts", self.prompts] if self.prompts.strip() else []
        arguments += ["--cameras", bpy.path.abspath(self.cameras)] if self.cameras else []
        arguments += ["--photo-masks", bpy.path.abspath(self.masks)] if self.masks else []
        arguments += ["--mask-background"] if self.mask_background else []
        arguments += ["--lens", FISHEYE_LENS] if self.fisheye else []
        return start_job(self, "reconstruct", project, *arguments)


class HERITAGE_FH_photos(DroppedIntoView, bpy.types.FileHandler):
    """Imports the folder of the photos that are dropped into the viewport. Blender takes no dropped folders."""

    bl_idname = "HERITAGE_FH_photos"
    bl_label = "Photos as Gaussian Scene"
    bl_import_operator = "heritage.import_photo_folder"
    bl_file_extensions = ";".join(PHOTO_SUFFIXES)


class HERITAGE_FH_video(DroppedIntoView, bpy.types.FileHandler):
    """Imports a video that is dropped into the viewport."""

    bl_idname = "HERITAGE_FH_video"
    bl_label = "Video as Gaussian Scene"
    bl_import_operator = "heritage.import_photo_folder"
    bl_file_extensions = ";".join(VIDEO_SUFFIXES)


CLASSES = [HERITAGE_OT_import_photo_folder, HERITAGE_FH_photos, HERITAGE_FH_video]
