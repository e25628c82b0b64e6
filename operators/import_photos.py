"""File > Import > Photo Folder as Gaussian Scene."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import bpy
from bpy.props import BoolProperty, CollectionProperty, StringProperty

from ..engine.errors import PhotoError
from ..engine.photos.settings import VIDEO_SUFFIXES
from ..engine.project_content import default_project_folder
from ..engine.training.settings import PRESET_LIST
from ..gaussian_heritage_addon import job_runner
from ..gaussian_heritage_addon.translations import translated
from ..gaussian_heritage_addon.typed_properties import blender_properties
from .dropped_files import DroppedIntoView

__all__ = ["CLASSES"]

_DIALOG_WIDTH = 450
_PHOTO_SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".heic", ".heif")
"""What may be dropped. The engine reads the whole folder, also files with other suffixes."""
OFFERED_PRESETS = [preset for preset in PRESET_LIST if preset.offered]


def _search_presets(operator: bpy.types.Operator, context: bpy.types.Context, typed: str) -> list[tuple[str, str]]:
    return [(preset.name, translated(preset.description)) for preset in OFFERED_PRESETS]


@blender_properties
class HERITAGE_OT_import_photo_folder(bpy.types.Operator):
    """Turn a folder of photos, or a video, into a Gaussian scene. Resumes an earlier import of the same photos"""

    bl_idname = "heritage.import_photo_folder"
    bl_label = "Import Photo Folder"

    directory: Annotated[str, StringProperty(name="Photos", description="Folder with the photos", subtype="DIR_PATH")]
    filepath: Annotated[
        str,
        StringProperty(
            name="Video",
            description="A video to take the photos from, instead of a folder",
            subtype="FILE_PATH",
            options={"SKIP_SAVE"},
        ),
    ]
    files: Annotated[
        Sequence[bpy.types.OperatorFileListElement],
        CollectionProperty(
            type=bpy.types.OperatorFileListElement,
            name="Files",
            description="Photos that were dropped; all photos of their folder are used",
            options={"HIDDEN", "SKIP_SAVE"},
        ),
    ]
    project: Annotated[
        str,
        StringProperty(
            name="Project",
            description="Project folder; empty: create it next to the photo folder",
            subtype="DIR_PATH",
            options={"SKIP_SAVE"},
        ),
    ]
    prompts: Annotated[
        str,
        StringProperty(
            name="Objects",
            description="Objects to isolate at the end, in English words, separated by commas (vase, teapot)",
            options={"SKIP_SAVE"},
        ),
    ]
    cameras: Annotated[
        str,
        StringProperty(
            name="Cameras",
            description="Known cameras of COLMAP, nerfstudio, Metashape or RealityCapture; empty: estimate the cameras",
            subtype="FILE_PATH",
            options={"SKIP_SAVE"},
        ),
    ]
    masks: Annotated[
        str,
        StringProperty(
            name="Masks",
            description="Folder with a mask for each photo, named like it; what is black in them is left out",
            subtype="DIR_PATH",
            options={"SKIP_SAVE"},
        ),
    ]
    mask_background: Annotated[
        bool,
        BoolProperty(
            name="Mask Background",
            description="Leave the background out, for an object on a turntable before a background that stands still",
            default=False,
            options={"SKIP_SAVE"},
        ),
    ]
    # A string, not an enum: scripts may name any preset of the engine, which rejects unknown names.
    preset: Annotated[
        str,
        StringProperty(
            name="Preset",
            description="How much work; the list says what each choice takes",
            default="standard",
            search=_search_presets,
        ),
    ]
    filter_folder: Annotated[bool, BoolProperty(default=True, options={"HIDDEN"})]
    filter_image: Annotated[bool, BoolProperty(default=True, options={"HIDDEN"})]
    filter_movie: Annotated[bool, BoolProperty(default=True, options={"HIDDEN"})]

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
        arguments += ["--prompts", self.prompts] if self.prompts.strip() else []
        arguments += ["--cameras", bpy.path.abspath(self.cameras)] if self.cameras else []
        arguments += ["--photo-masks", bpy.path.abspath(self.masks)] if self.masks else []
        arguments += ["--mask-background"] if self.mask_background else []
        state = job_runner.start("reconstruct", project, *arguments)
        message = "Working in the background; see the Heritage panel." if state is None else state.message
        self.report({"INFO"}, message)
        return {"FINISHED"}


class HERITAGE_FH_photos(DroppedIntoView, bpy.types.FileHandler):
    """Imports the folder of the photos that are dropped into the viewport. Blender takes no dropped folders."""

    bl_idname = "HERITAGE_FH_photos"
    bl_label = "Photos as Gaussian Scene"
    bl_import_operator = "heritage.import_photo_folder"
    bl_file_extensions = ";".join(_PHOTO_SUFFIXES)


class HERITAGE_FH_video(DroppedIntoView, bpy.types.FileHandler):
    """Imports a video that is dropped into the viewport."""

    bl_idname = "HERITAGE_FH_video"
    bl_label = "Video as Gaussian Scene"
    bl_import_operator = "heritage.import_photo_folder"
    bl_file_extensions = ";".join(VIDEO_SUFFIXES)


CLASSES = [HERITAGE_OT_import_photo_folder, HERITAGE_FH_photos, HERITAGE_FH_video]
