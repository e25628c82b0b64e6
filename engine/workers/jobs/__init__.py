"""Engine processes as seen from outside: started, polled, stopped and found again. Blender and the server use them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .click_preview import ClickAnswer, ClickPreview, click_question, pack_mask, read_question
    from .engine_run import EngineRun, run_as_child
    from .job import Job, JobState, format_seconds
    from .prompt_arguments import (
        Click,
        any_word_arguments,
        click_arguments,
        name_arguments,
        refine_arguments,
        text_arguments,
    )
    from .time_left import seconds_left_in_all
    from .waiting import WaitingJob, WaitingJobs

__getattr__ = lazy_exports(__name__, __file__)
