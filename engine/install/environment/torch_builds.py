"""Which build of torch is installed, and from where.

PyPI has CUDA builds for Linux and CPU builds for macOS (with Apple's GPU) and Windows; their hashes are in
``locked-torch.txt``. The other builds come from PyTorch's own index, or from a configured index that has them. Their
hashes are not known.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...core.errors import EnvironmentProblem
from ...core.system import has_nvidia_driver, package_system
from .locked import hashes_in, locked_arguments, locked_file, pinned
from .pip_command import Pip
from .target import Target

PYTORCH_INDEX = "https://download.pytorch.org/whl/"
_ALONE: list[object] = ["--no-deps", "--only-binary", ":all:"]
_UNVERIFIED = "; its SHA-256 is not in locked-torch.txt, so it is not checked"


@dataclass(frozen=True)
class TorchSource:
    """Where a build of torch comes from.

    Attributes
    ----------
    build : {"cpu", "cuda"}
    arguments : tuple
        For ``pip install``.
    one_index : bool
        Whether only the index in `arguments` may be asked.
    what : str
        Build and source as text, with a note where no hash is checked.
    """

    build: str
    arguments: tuple[object, ...]
    one_index: bool
    what: str


def default_build() -> str:
    """Return "cuda" where this computer has an NVIDIA driver, else "cpu"; on macOS, "cpu" includes Apple's GPU."""
    return "cuda" if has_nvidia_driver() else "cpu"


def torch_source(pip: Pip, build: str, target: Target | None = None) -> TorchSource:
    """Return where `build` comes from.

    Parameters
    ----------
    pip : Pip
        Its Python decides which files fit.
    build : {"cpu", "cuda"}
    target : Target, optional
        The computer that it is for; by default, this one.

    Returns
    -------
    TorchSource
        Its build is "cuda" where "cpu" was asked for, and only a CUDA build can be reached.

    Raises
    ------
    EnvironmentProblem
        When no index that can be reached has torch for this Python.
    """
    torch, others = pinned(locked_file("torch")), [] if target is None else target.arguments
    # PyPI's torch for Linux is the one for CUDA.
    is_linux = (package_system() if target is None else target.system.packages).startswith("linux")
    index = PYTORCH_INDEX + ("cu130" if build == "cuda" else "cpu")
    own = TorchSource(
        build, (*others, *_ALONE, "--index-url", index, torch), True, f"torch ({build}) from {index}{_UNVERIFIED}"
    )
    if build == "cuda" and not is_linux:
        return own
    with_cuda = TorchSource(
        "cuda",
        (*others, *locked_arguments(locked_file("torch")), "--requirement", locked_file("cuda")),
        False,
        "torch (cuda)",
    )
    if build == "cuda":
        return with_cuda
    offered = pip.offered([*others, *_ALONE, torch], elsewhere=target is not None)
    if offered is not None and not (is_linux and _needs_cuda(offered)):
        if _sha256_of(offered) in hashes_in(locked_file("torch")):
            return TorchSource("cpu", (*others, *locked_arguments(locked_file("torch"))), False, "torch (cpu)")
        return TorchSource("cpu", (*others, *_ALONE, torch), False, f"torch (cpu){_UNVERIFIED}")
    if pip.offered(own.arguments, one_index=True, elsewhere=target is not None) is not None:
        return own
    if offered is None:
        raise EnvironmentProblem(
            f"Neither pip's index nor {index} offers {torch} for {pip.python}. Check the network (proxy, firewall) and "
            "try again."
        )
    return with_cuda


def _needs_cuda(offered: dict[str, Any]) -> bool:
    """Return whether the torch of pip's report requires the packages of CUDA on Linux."""
    names = offered["metadata"].get("requires_dist", [])
    return any(name.startswith(("nvidia-", "triton", "cuda-")) for name in names)


def _sha256_of(offered: dict[str, Any]) -> str:
    """Return the SHA-256 in pip's report of a package; a word that is no hash when the index states none."""
    return str(offered["download_info"].get("archive_info", {}).get("hashes", {}).get("sha256", "unknown"))
