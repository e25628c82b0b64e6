"""The exceptions of the engine. Their messages are shown to users as they are.

Every message says what is wrong, with which file, and what to do. Only two places catch the base class: the
engine's entry point (an ``error`` event, one sentence, a nonzero exit code) and
`gaussian_heritage_addon.blender.problems`::

    HeritageError
    |-- SettingsError       a setting, flag or number that cannot be used
    |-- PhotoError          the photo folder or a photo
    |-- CameraError         camera poses could not be found or read
    |-- MaskError           a mask image that cannot be used
    |-- TrainingError       Gaussians could not be trained
    |-- NumericalError      a value that is not finite, with the name of its array
    |-- ObjectError         a requested object that does not exist or cannot be made
    |   `-- PromptError     a prompt that matched nothing or was not understood
    |-- FormatError         a PLY, glTF or JSON file with invalid content
    |-- ProjectError        the project folder: in use, not a project, changed meanwhile
    |   |-- ProjectInUse    another job is working in it
    |   `-- DiskError       full, read-only or unreachable
    |-- ModelFileError      a weight file that is missing or damaged
    |-- EnvironmentProblem  this machine lacks something the engine needs
    `-- Cancelled           the user stopped the work; everything done so far is kept
"""

from __future__ import annotations

__all__ = [
    "CameraError",
    "Cancelled",
    "DiskError",
    "EnvironmentProblem",
    "FormatError",
    "HeritageError",
    "MaskError",
    "ModelFileError",
    "NumericalError",
    "ObjectError",
    "PhotoError",
    "ProjectError",
    "ProjectInUse",
    "PromptError",
    "SettingsError",
    "StartError",
    "TrainingError",
    "is_out_of_memory",
]


class HeritageError(Exception):
    """Base class of all errors a user may see. ``exit_code`` is what the command line returns."""

    exit_code = 1


class SettingsError(HeritageError):
    """A setting, flag or number that cannot be used."""

    exit_code = 2


class PhotoError(HeritageError):
    """The photo folder or a photo in it cannot be used."""


class CameraError(HeritageError):
    """Camera poses could not be found or read."""


class MaskError(HeritageError):
    """A mask image cannot be used."""


class TrainingError(HeritageError):
    """Gaussians could not be trained."""


class NumericalError(HeritageError):
    """A value is not finite; the message names the array."""


class ObjectError(HeritageError):
    """A requested object does not exist or cannot be made."""


class PromptError(ObjectError):
    """A prompt matched nothing, or is outside of the detector's vocabulary."""

    exit_code = 3


class FormatError(HeritageError):
    """The content of a file is not what its format demands."""


class ProjectError(HeritageError):
    """The project folder cannot be used as it is."""


class ProjectInUse(ProjectError):
    """Another job is working in the project folder."""


class DiskError(ProjectError):
    """The disk is full, read-only or unreachable."""


class StartError(DiskError):
    """A program cannot be started."""


class ModelFileError(HeritageError):
    """A weight file is missing or damaged."""


class EnvironmentProblem(HeritageError):
    """This machine lacks something the engine needs."""


class Cancelled(HeritageError):
    """The user stopped the work. The project folder stays, and the next run continues."""

    exit_code = 130


_OUT_OF_MEMORY_TEXTS = (
    "can't allocate memory",  # torch
    "not enough memory",  # torch on Windows
    "out of memory",  # torch on a GPU
    "Insufficient memory",  # OpenCV
    "Cannot allocate memory",  # the operating system
    "can't start new thread",
    "failed to map segment from shared object",  # a library could not be loaded
)


def is_out_of_memory(error: BaseException) -> bool:
    """Return whether `error` means that memory is full; most libraries do not raise `MemoryError` for that."""
    return isinstance(error, MemoryError) or any(text in str(error) for text in _OUT_OF_MEMORY_TEXTS)
