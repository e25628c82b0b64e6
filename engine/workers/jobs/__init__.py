"""Engine processes as seen from outside: started, polled, stopped and found again. Blender and the server use them."""

from .click_preview import ClickAnswer, ClickPreview, click_question, pack_mask, read_question
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

__all__ = [
    "Click",
    "ClickAnswer",
    "ClickPreview",
    "Job",
    "JobState",
    "WaitingJob",
    "WaitingJobs",
    "any_word_arguments",
    "click_arguments",
    "click_question",
    "format_seconds",
    "name_arguments",
    "pack_mask",
    "read_question",
    "refine_arguments",
    "seconds_left_in_all",
    "text_arguments",
]
