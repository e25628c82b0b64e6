"""Engine processes as seen from outside: started, polled, stopped and found again. Blender and the server use them."""

from .job import Job, JobState, format_seconds
from .waiting import WaitingJob

__all__ = ["Job", "JobState", "WaitingJob", "format_seconds"]
