"""Files are read and deleted in engine/core/files only, where size, type and shape are checked before use."""

from __future__ import annotations

import ast
import functools
from collections import Counter

import pytest

from tests.conftest import ROOT

from .sources import parsed

FOLDERS = ("engine", "gaussian_heritage_addon", "operators")
CHECKED = "engine/core/files"
"""The package that reads, writes and deletes."""

FORBIDDEN = {
    "json.load": "read_json",
    "json.loads": "parse_json",
    "json.JSONDecoder": "parse_json",
    "numpy.load": "read_array or read_arrays",
    "numpy.fromfile": "read_array",
    "numpy.memmap": "read_array(mapped=True)",
    "numpy.loadtxt": "read_text",
    "numpy.genfromtxt": "read_text",
    "torch.load": "read_arrays",
    "zipfile.ZipFile": "read_arrays",
    "zipfile.is_zipfile": "read_arrays",
    "tarfile.open": "nothing: archives are not unpacked",
    "tarfile.TarFile": "nothing: archives are not unpacked",
    "gzip.open": "opened",
    "bz2.open": "opened",
    "lzma.open": "opened",
    "codecs.open": "opened",
    "io.open": "opened",
    "io.FileIO": "opened",
    "os.open": "opened",
    "open": "opened",
    ".open": "opened",
    ".read_text": "read_text",
    ".read_bytes": "read_bytes",
    "shutil.rmtree": "delete_derived",
    "shutil.unpack_archive": "nothing: archives are not unpacked",
    "os.remove": "delete_derived",
    "os.unlink": "delete_derived",
    ".unlink": "delete_derived",
}
"""Call: what to use of `engine.core.files` instead. A name with a dot in front is a method of any object."""
FORBIDDEN_MODULES = ("pickle", "marshal", "shelve", "dill", "joblib")
"""Modules that run code from the data that they read."""

_OWN_CODE = "the program's own source, which lies beside this file"
_SYSTEM = "a file of the Linux kernel, which has no size and belongs to no project"
_STEP = "the step of engine/core/files that waits for other programs"
_ARCHIVE = "takes one file of a downloaded package, whose size the catalogue states, out of a stream from `opened`"
_BUNDLE = "an offline bundle: only files that it lists in two folders are unpacked, with their SHA-256"
_PILLOW = "gets a stream from `opened`; the number of pixels is checked before they are decoded"
EXCEPTIONS: dict[tuple[str, str], str] = {
    ("engine/core/lazy_exports.py", ".read_text"): _OWN_CODE,
    ("engine/rasterizer/jit.py", ".read_bytes"): _OWN_CODE,
    ("engine/core/system/machine.py", ".read_text"): _SYSTEM,
    ("engine/core/system/limits.py", ".read_text"): _SYSTEM,
    ("engine/core/system/processes.py", ".read_bytes"): _SYSTEM,
    ("engine/core/system/times.py", ".open"): "a handle for a question about the file, which is not read",
    ("engine/core/system/paths.py", "shutil.rmtree"): "a folder that it has just made, for a trial",
    ("engine/core/system/replacing.py", "shutil.rmtree"): _STEP,
    ("engine/core/system/replacing.py", ".unlink"): _STEP,
    (
        "engine/objects/grounding/efficientnet.py",
        "torch.load",
    ): "reads a weight file after its SHA-256 was checked, and unpickles tensors only (weights_only)",
    ("engine/core/child_process.py", "os.open"): "the null device",
    (
        "engine/core/child_process.py",
        "json.loads",
    ): "the request of the parent process, which is this program; names of files "
    "in it may have characters that `parse_json` refuses",
    ("engine/formats/usd.py", ".open"): "the file that OpenUSD has just written, whose bytes are forced to the disk",
    ("engine/formats/mesh_usdz.py", "zipfile.ZipFile"): "a file that is written",
    ("engine/formats/sog_writing.py", "zipfile.ZipFile"): "a file that is written",
    ("engine/pictures/webp.py", "PIL.Image.open"): "bytes whose size in pixels was checked; every error is translated",
    ("gaussian_heritage_addon/splats/sog_pictures.py", ".read_bytes"): "the picture that Blender has just written",
    ("engine/cameras/colmap_calls.py", ".open"): "the database of the run's own folder; every error is translated",
    ("engine/install/models/archives.py", "zipfile.is_zipfile"): _ARCHIVE,
    ("engine/install/models/archives.py", "zipfile.ZipFile"): _ARCHIVE,
    ("engine/install/models/archives.py", ".open"): _ARCHIVE,
    ("engine/install/models/archives.py", "tarfile.TarFile"): _ARCHIVE,
    ("engine/core/https.py", ".open"): "a connection, no file",
    ("engine/install/environment/locked.py", ".read_text"): _OWN_CODE,
    (
        "engine/workers/jobs/waiting.py",
        ".unlink",
    ): "a file in a folder of ours; whether it was there decides which of several Blenders starts the job",
    ("engine/install/environment/bundle.py", "zipfile.ZipFile"): _BUNDLE,
    ("engine/install/environment/bundle.py", ".open"): _BUNDLE,
    ("engine/install/environment/pip_command.py", ".open"): "the log of pip, whose lines are only shown",
    ("engine/photos/pixels.py", "PIL.Image.open"): _PILLOW,
    ("engine/photos/heic_tiles.py", "av.open"): "gets the stream of a picture that Pillow has opened",
    ("engine/objects/prompts.py", "PIL.Image.open"): _PILLOW,
    ("engine/project/folder.py", ".open"): "the lock, whose content is never read",
    ("engine/quality/evaluation/ground_truth.py", "PIL.Image.open"): _PILLOW,
}
"""Call in a file: why it is right there. Keep this short; an exception without a use is an error."""


class _Calls(ast.NodeVisitor):
    """Collects the forbidden calls of a module, also under other names."""

    def __init__(self) -> None:
        self.names: dict[str, str] = {}
        self.found: list[tuple[int, str]] = []

    def visit_Import(self, node: ast.Import) -> None:
        for alias in node.names:
            package = alias.name.partition(".")[0]
            self.names[alias.asname or package] = alias.name if alias.asname else package
            self._check_module(node, alias.name)

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        if node.level == 0 and node.module:
            self._check_module(node, node.module)
            for alias in node.names:
                self.names[alias.asname or alias.name] = f"{node.module}.{alias.name}"

    def visit_Call(self, node: ast.Call) -> None:
        self.generic_visit(node)
        function = node.func
        if isinstance(function, ast.Attribute):
            # Only the call of `open` tells whether it reads.
            if function.attr == "open" and self._qualified(function) not in FORBIDDEN and not _writes_only(node):
                self._note(node, self._qualified(function) or ".open")
        elif isinstance(function, ast.Name):
            name = self.names.get(function.id, function.id)
            if name in FORBIDDEN and not (name == "open" and _writes_only(node)):
                self._note(node, name)

    def visit_Attribute(self, node: ast.Attribute) -> None:
        """Find functions of modules and methods, whether they are called or passed on, as in ``map(json.loads, x)``."""
        self.generic_visit(node)
        qualified, method = self._qualified(node), f".{node.attr}"
        if qualified in FORBIDDEN:
            self._note(node, qualified)
        elif method in FORBIDDEN and method != ".open":
            self._note(node, method)

    def _qualified(self, node: ast.expr) -> str | None:
        """Return the full name of an attribute of an imported module, None for a method of a value."""
        parts: list[str] = []
        while isinstance(node, ast.Attribute):
            parts.append(node.attr)
            node = node.value
        if not isinstance(node, ast.Name) or node.id not in self.names:
            return None
        return ".".join([self.names[node.id], *reversed(parts)])

    def _check_module(self, node: ast.stmt, module: str) -> None:
        if module.partition(".")[0] in FORBIDDEN_MODULES:
            self._note(node, module)

    def _note(self, node: ast.expr | ast.stmt, call: str) -> None:
        self.found.append((node.lineno, call))


def _writes_only(call: ast.Call) -> bool:
    """Return whether a call of ``open``, a function or a method, has a mode that does not read."""
    position = 1 if isinstance(call.func, ast.Name) else 0
    given = [keyword.value for keyword in call.keywords if keyword.arg == "mode"] or call.args[position : position + 1]
    if not given or not isinstance(given[0], ast.Constant) or not isinstance(given[0].value, str):
        return False
    mode = given[0].value
    return bool(mode) and mode[0] in "wax" and set(mode) <= set("waxbt")


def forbidden_calls(source: str) -> list[tuple[int, str]]:
    """Return line and name of each forbidden call."""
    calls = _Calls()
    calls.visit(parsed(source))
    return sorted(calls.found)


@functools.cache
def places() -> list[tuple[str, int, str]]:
    """All forbidden calls outside of `CHECKED` as (file, line, call)."""
    found = []
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            file = path.relative_to(ROOT).as_posix()
            if not file.startswith(CHECKED + "/"):
                found += [(file, line, call) for line, call in forbidden_calls(path.read_text(encoding="utf-8"))]
    return found


def test_files_are_read_and_deleted_in_one_package() -> None:
    found = [
        f"{file}:{line}: {call}; use {FORBIDDEN.get(call, 'engine.core.files')}"
        for file, line, call in places()
        if (file, call) not in EXCEPTIONS
    ]
    assert found == [], f"{len(found)} places:\n" + "\n".join(found)


def test_no_exception_is_stale() -> None:
    used = Counter((file, call) for file, _, call in places())
    stale = [f"{file}: {call}" for file, call in EXCEPTIONS if not used[file, call]]
    assert stale == [], "delete these exceptions"


@pytest.mark.parametrize(
    ("source", "call"),
    [
        ("import json\njson.loads(x)", "json.loads"),
        ("import json as j\nj.load(x)", "json.load"),
        ("from json import loads\nloads(x)", "json.loads"),
        ("from json import loads as parse\nparse(x)", "json.loads"),
        ("import json\nlist(map(json.loads, x))", "json.loads"),
        ("list(map(Path.read_text, x))", ".read_text"),
        ("import numpy as np\nnp.load(x)", "numpy.load"),
        ("import numpy as np\nnp.fromfile(x)", "numpy.fromfile"),
        ("import torch\ntorch.load(x)", "torch.load"),
        ("open(x)", "open"),
        ("open(x, 'rb')", "open"),
        ("open(x, mode)", "open"),
        ("open(x, 'w+')", "open"),
        ("path.open()", ".open"),
        ("path.open('rb')", ".open"),
        ("path.open('a+')", ".open"),
        ("path.open(mode='r')", ".open"),
        ("from PIL import Image\nImage.open(path)", "PIL.Image.open"),
        ("path.read_text(encoding='utf-8')", ".read_text"),
        ("Path(x).read_bytes()", ".read_bytes"),
        ("import pickle", "pickle"),
        ("from pickle import loads", "pickle"),
        ("import zipfile\nzipfile.ZipFile(x)", "zipfile.ZipFile"),
        ("import tarfile\nwith tarfile.open(x) as archive: pass", "tarfile.open"),
        ("import shutil\nshutil.rmtree(x)", "shutil.rmtree"),
        ("from shutil import rmtree\nrmtree(x)", "shutil.rmtree"),
        ("import os\nos.unlink(x)", "os.unlink"),
        ("def f():\n    import os\n    os.remove(x)", "os.remove"),
        ("path.unlink(missing_ok=True)", ".unlink"),
    ],
)
def test_planted_reading_or_deleting_is_found(source: str, call: str) -> None:
    assert [name for _, name in forbidden_calls(source)] == [call]


@pytest.mark.parametrize(
    "source",
    [
        "open(x, 'w', encoding='utf-8')",
        "path.open('ab')",
        "path.open(mode='x')",
        "import json\njson.dumps(x)",
        "import numpy as np\nnp.save(stream, x)",
        "from .files import read_text\nread_text(path, advice='')",
    ],
)
def test_writing_and_our_own_readers_are_right(source: str) -> None:
    assert forbidden_calls(source) == []
