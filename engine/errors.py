"""What can go wrong, as sentences for the person at the screen.

Every message says what is wrong, with which file, and what to do. Only two places catch the root: the engine's
entry point (an ``error`` event, one sentence, an exit code that is not 0) and a Blender operator (``report``)::

    HeritageError
    |-- SettingsError       a setting, flag or number that cannot be used
    |-- PhotoError          the photo folder or a photo
    |-- CameraError         camera poses could not be found or read
    |-- MaskError           a mask image that cannot be used
    |-- TrainingError       Gaussians could not be trained
    |-- NumericalError      a value that is not finite, with the name of its array
    |-- ObjectError         an object that was asked for and cannot be given
    |   `-- PromptError     a prompt that found nothing, or is not understood
    |-- FormatError         a PLY, glTF or JSON file that is not what it should be
    |-- ProjectError        the project folder: in use, not one of ours, changed underneath
    |   `-- DiskError       full, read-only or unreachable
    |-- ModelFileError      a weight file that is missing or damaged
    |-- EnvironmentProblem  this machine lacks something the engine needs
    `-- Cancelled           the person asked to stop; everything done so far is kept
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
    "PromptError",
    "SettingsError",
    "TrainingError",
    "is_out_of_memory",
]


class HeritageError(Exception):
    """Root of all errors a user may see. ``exit_code`` is what the command line returns."""

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
    """A value that is not finite; the message names the array."""


class ObjectError(HeritageError):
    """An object that was asked for and cannot be given."""


class PromptError(ObjectError):
    """A prompt that found nothing or is outside what the detector knows."""

    exit_code = 3


class FormatError(HeritageError):
    """A file that is not what its name says."""


class ProjectError(HeritageError):
    """The project folder cannot be used as it is."""


class DiskError(ProjectError):
    """The disk is full, read-only or unreachable."""


class ModelFileError(HeritageError):
    """A weight file is missing or damaged."""


class EnvironmentProblem(HeritageError):
    """This machine lacks something the engine needs."""


class Cancelled(HeritageError):
    """The person asked to stop. The project folder stays and the next run continues."""

    exit_code = 130


_SAID_WITHOUT_MEMORY = (
    "can't allocate memory",  # torch
    "not enough memory",  # torch on Windows
    "out of memory",  # torch on a GPU
    "Insufficient memory",  # OpenCV
    "Cannot allocate memory",  # the system
    "can't start new thread",
)


def is_out_of_memory(error: BaseException) -> bool:
    """Return whether `error` means that memory is full; most libraries say so without a `MemoryError`."""
    return isinstance(error, MemoryError) or any(words in str(error) for words in _SAID_WITHOUT_MEMORY)
