"""Objects > Learn My Words: the user's own vocabulary is taught and used by this project, or no longer."""

from __future__ import annotations

import bpy

from ..engine.project.folder import ProjectFolder
from ..engine.project.own_words import learns_words, set_learning
from ..gaussian_heritage_addon.splats.properties import project_of
from .project_operator import ProjectOperator


class HERITAGE_OT_learn_words(ProjectOperator, bpy.types.Operator):
    """Objects that you name, click or accept teach their words, which this and other learning projects then find"""

    bl_idname = "heritage.learn_words"
    bl_label = "Learn My Words"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Let the project learn, or stop it."""
        with ProjectFolder.open_existing(project_of(context.scene.heritage)) as project:
            set_learning(project, not learns_words(project))
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_learn_words]
