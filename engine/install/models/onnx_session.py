"""Open an ONNX model on the CPU or on a graphics card; the only module that imports onnxruntime.

Cards are used by the CUDA provider, which other builds of onnxruntime contain, or else by the WebGPU provider for cards
of all vendors, which the package `onnxruntime-ep-webgpu` adds to any build.
"""

from __future__ import annotations

import contextlib
import functools
import importlib
import importlib.util
import io
import logging
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from ...core.errors import EnvironmentProblem, ModelFileError
from .catalogue import CATALOGUE

if TYPE_CHECKING:
    import onnxruntime

_LOG = logging.getLogger(__name__)

_CUDA = "CUDAExecutionProvider"
_PLUGIN = "onnxruntime_ep_webgpu"
_PLUGIN_PACKAGE = "onnxruntime-ep-webgpu"

_Provider = tuple[str, str, list[Any] | None]
"""Name in a session, description, and the `providers` of a session."""


class Session(Protocol):
    """The methods of an inference session that are used."""

    def get_inputs(self) -> Sequence[Any]: ...

    def get_outputs(self) -> Sequence[Any]: ...

    def run(self, names: Sequence[str] | None, inputs: dict[str, Any]) -> Sequence[Any]: ...


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
    onnxruntime = _imported()
    name = next((f" {model.name}" for model in CATALOGUE.values() if model.file == path.name), "")
    if not path.is_file():
        raise ModelFileError(f"The model file {path} is missing. Run: python -m engine models fetch{name}")
    try:
        return onnxruntime.InferenceSession(str(path), _options(threads), providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's exceptions have no common base class but Exception
        raise ModelFileError(
            f"The model file {path} cannot be opened ({str(error).splitlines()[0]}). "
            f"Delete it and run: python -m engine models fetch{name}"
        ) from error


def gpu_provider_is_installed() -> bool:
    """Return whether onnxruntime has a provider for graphics cards; none is loaded to find out."""
    return _CUDA in _imported().get_available_providers() or importlib.util.find_spec(_PLUGIN) is not None


def open_gpu_session(path: Path) -> tuple[onnxruntime.InferenceSession | None, str]:
    """Return an inference session on a graphics card.

    Its results are not checked: the caller compares them with those of the CPU.

    Parameters
    ----------
    path : Path
        An ONNX file that `open_session` can open.

    Returns
    -------
    session : onnxruntime.InferenceSession or None
        None without a provider, without a card, or when every provider that is installed fails.
    description : str
        The provider, or why there is no session, of each provider; part of a sentence without a full stop.
    """
    refusals: list[str] = []
    for provider in (_cuda, _webgpu):
        session, description = _try(provider, path)
        if session is not None:
            return session, ", because ".join([description, *refusals])
        if description:
            refusals.append(description)
    if not refusals:
        refusals = [f"onnxruntime has no provider for graphics cards; `pip install {_PLUGIN_PACKAGE}` adds one"]
    return None, ", and ".join(refusals)


def _try(
    provider: Callable[[onnxruntime.SessionOptions], _Provider | str], path: Path
) -> tuple[onnxruntime.InferenceSession | None, str]:
    """Return a session and its provider, or None and why there is no session; nothing if it is not installed."""
    options = _options(threads=1)
    try:
        found = provider(options)
        if isinstance(found, str):
            return None, found
        name, description, providers = found
        # With its fallback, onnxruntime would print to standard output and go on with the CPU.
        session = _imported().InferenceSession(str(path), options, providers=providers, enable_fallback=0)
    except Exception as error:  # no common base class, as above; drivers raise anything
        _LOG.info("No graphics card for %s", path.name, exc_info=True)
        return None, f"onnxruntime cannot use a graphics card ({(str(error).splitlines() or ['unknown'])[0]})"
    if name not in session.get_providers():
        return None, f"onnxruntime's {description} did not start; its libraries may be missing"
    return session, description


def _cuda(options: onnxruntime.SessionOptions) -> _Provider | str:
    """Return CUDA's provider, or why it cannot be used; nothing if it is not installed."""
    if _CUDA not in _imported().get_available_providers():
        return ""
    # Finds CUDA's libraries where pip installed them beside onnxruntime. It prints what it does not find.
    with contextlib.redirect_stdout(io.StringIO()):
        _imported().preload_dlls()
    # Without TF32, which rounds factors to 10 bits and fails the caller's self-test.
    return _CUDA, "CUDA", [(_CUDA, {"use_tf32": "0"}), "CPUExecutionProvider"]


def _webgpu(options: onnxruntime.SessionOptions) -> _Provider | str:
    """Return the same of the WebGPU plugin, which is added to `options`."""
    try:
        device = _webgpu_device()
    except ImportError:
        return ""
    if device is None:
        return f"{_PLUGIN_PACKAGE} finds no graphics card"
    options.add_provider_for_devices([device], {})
    return device.ep_name, f"WebGPU ({device.device.vendor})", None


@functools.cache
def _webgpu_device() -> Any | None:
    """Return onnxruntime's device of the WebGPU plugin, None without a card; raises ImportError without the plugin."""
    onnxruntime, plugin = _imported(), importlib.import_module(_PLUGIN)
    # Once per process; a second registration is an error.
    onnxruntime.register_execution_provider_library(_PLUGIN, plugin.get_library_path())
    return next((found for found in onnxruntime.get_ep_devices() if found.ep_name == plugin.get_ep_name()), None)


def _imported() -> Any:
    try:
        import onnxruntime
    except ImportError as error:
        raise EnvironmentProblem(
            "onnxruntime is not installed in the engine's environment. Set up the engine again."
        ) from error
    return onnxruntime


def _options(threads: int) -> onnxruntime.SessionOptions:
    options = _imported().SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    # Idle workers must sleep: spinning ones occupy cores that the rest of the engine needs between two calls.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.log_severity_level = 3
    return options
