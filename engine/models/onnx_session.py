"""Open an ONNX model on the CPU; the only module that imports onnxruntime."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import EnvironmentProblem, ModelFileError
from .catalogue import CATALOGUE

if TYPE_CHECKING:
    import onnxruntime

__all__ = ["open_session"]


def open_session(path: Path, *, threads: int = 2) -> onnxruntime.InferenceSession:
    """Return an open inference session on the CPU.

    Parameters
    ----------
    path : Path
        An ONNX file, from `models.locate`.
    threads : int
        Worker threads within one operator, at least 1.

    Raises
    ------
    ModelFileError
        When the file is missing or is not an ONNX model.
    EnvironmentProblem
        When onnxruntime is not installed.
    """
    try:
        import onnxruntime
    except ImportError as error:
        raise EnvironmentProblem(
            "onnxruntime is not installed in the engine's environment. Set up the engine again."
        ) from error
    name = next((f" {model.name}" for model in CATALOGUE.values() if model.file == path.name), "")
    if not path.is_file():
        raise ModelFileError(f"The model file {path} is missing. Run: python -m engine models fetch{name}")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    # Idle workers must sleep: spinning ones occupy cores that the rest of the engine needs between two calls.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.log_severity_level = 3
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's exceptions have no common base class but Exception
        raise ModelFileError(
            f"The model file {path} cannot be opened ({str(error).splitlines()[0]}). "
            f"Delete it and run: python -m engine models fetch{name}"
        ) from error
