"""The add-on's page in the preferences: the engine's Python, and the model files with their licences."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty

from ...engine.masks.settings import SAM_MODELS
from ..blender.drawn_text import draw_text
from ..blender.folder_size import folder_bytes
from ..blender.typed_properties import blender_properties
from ..jobs import job_runner
from ..language.translations import translated
from ..setup.installation import installed_engine
from ..setup.model_files import Model, States, find_model, list_models, stored_states
from ..setup.preferences import BASE_PACKAGE
from .job_box import draw_job
from .set_up_box import draw_set_up, set_up_label

_ICONS = {"AVAILABLE": "CHECKMARK", "PROBLEM": "ERROR", "UNKNOWN": "QUESTION"}


@blender_properties
class HeritagePreferences(bpy.types.AddonPreferences):
    """Preferences of the add-on."""

    bl_idname = BASE_PACKAGE

    engine_python: str = StringProperty(
        name="Existing Python",
        description="Python with the engine's packages that is run instead of the engine that was set up here. "
        "Empty: the one named by the environment variable GAUSSIAN_HERITAGE_PYTHON, or .venv/engine in the folder "
        "of this extension if it is a checkout of the repository, or the engine that was set up. No other place is "
        "searched, and no .blend file can change it",
        subtype="FILE_PATH",
    )
    base_python: str = StringProperty(
        name="Python for Set-Up",
        description="Python 3.11, 3.12 or 3.13 that the engine is set up with. Empty: Blender's own where "
        "PyTorch can be had for it, or another one of this computer",
        subtype="FILE_PATH",
    )
    offline_bundle: str = StringProperty(
        name="Offline Bundle",
        description="File that the engine is set up from, without a network; empty: download everything",
        subtype="FILE_PATH",
    )
    torch_build: str = EnumProperty(
        name="PyTorch",
        description="Build of PyTorch that is installed",
        items=[
            ("AUTO", "Automatic", "For NVIDIA graphics cards where this computer has their driver"),
            ("CPU", "Processor", "Smaller; includes Apple's graphics processors on a Mac"),
            ("CUDA", "NVIDIA", "For NVIDIA graphics cards; 5 GB more"),
        ],
    )
    check_result: str = StringProperty(options={"SKIP_SAVE"})
    model_folder: str = StringProperty(
        name="Offline Folder",
        description="Folder with model files that you already have; empty: download them",
        subtype="DIR_PATH",
    )
    sam: str = EnumProperty(
        name="Segment Anything",
        description="Model that outlines objects in the photos; all except the first must be fetched before use",
        items=[(name, name, "") for name in SAM_MODELS],
    )
    show_licences: bool = BoolProperty(
        name="Licences", description="Show the licence of each model, and who may use it", options={"SKIP_SAVE"}
    )
    model_states: str = StringProperty(options={"SKIP_SAVE", "HIDDEN"})

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the preferences."""
        layout = self.layout
        is_offered = draw_set_up(layout.column(), in_preferences=True)
        column = layout.column()
        column.prop(self, "offline_bundle")
        column.prop(self, "base_python")
        column.prop(self, "torch_build")
        column.prop(self, "engine_python")
        row = layout.row()
        row.operator("heritage.check_engine", icon="CHECKMARK")
        if not is_offered:
            row.operator("heritage.set_up_engine", text=set_up_label(), icon="IMPORT")
        row.operator("heritage.remove_engine", text="Remove", icon="TRASH")
        _draw_what_stays(layout)
        for line in self.check_result.splitlines():
            layout.label(text=line)
        layout.separator()
        row = layout.row()
        row.label(text="Models")
        row.operator("heritage.check_models", text="List").verify = False
        row.operator("heritage.check_models", text="Verify").verify = True
        current = job_runner.current()
        if current is not None and current[0].kind in ("models", "doctor") and not current[1].finished:
            # The results of a finished job are shown with each model below.
            draw_job(layout, *current)
        layout.prop(self, "sam")
        draw_text(layout, find_model(self.sam).purpose)
        layout.prop(self, "model_folder")
        arrow = "TRIA_DOWN" if self.show_licences else "TRIA_RIGHT"
        layout.prop(self, "show_licences", icon=arrow, emboss=False)
        states = stored_states(self.model_states)
        for model in list_models():
            _draw_model(layout.box(), model, states, with_licence=self.show_licences)


def _draw_what_stays(layout: bpy.types.UILayout) -> None:
    """Say what uninstalling the add-on leaves on the disk. Blender itself removes only the add-on."""
    engine = installed_engine()
    if engine.state() == "missing":
        return
    size = folder_bytes(engine.folder)
    amount = "" if size is None else f" ({size / 1e9:.1f} GB)"
    draw_text(
        layout,
        translated(
            "Uninstalling the add-on leaves the engine{} in {}, and the model files. Press Remove first to delete it.",
            amount,
            str(engine.folder),
        ),
        icon="INFO",
    )


def _draw_model(box: bpy.types.UILayout, model: Model, states: States, *, with_licence: bool) -> None:
    state, problem = model.state(states)
    if state == "UNKNOWN" and not model.optional and installed_engine().state() == "ready":
        state = "AVAILABLE"  # The set-up ends only with the files that the engine needs.
    row = box.row()
    row.label(text=model.title, icon=_ICONS[state])
    if state != "AVAILABLE":
        row.operator("heritage.fetch_model", text="Fetch ...").name = model.name
    draw_text(box, model.purpose, n_boxes=1)
    for line in model.terms if with_licence else ():
        draw_text(box, line, n_boxes=1)
    if problem:
        draw_text(box, problem, icon="INFO", n_boxes=1)


CLASSES = [HeritagePreferences]
