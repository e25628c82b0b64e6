"""One table says which formats there are: what it promises is true, and nothing else lists them."""

from __future__ import annotations

import ast
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from engine.core.errors import SettingsError
from engine.formats import DEFAULT_FORMAT, FORMATS, FileFacts, WritingTools, format_of, kind_of, read_other, write_scene
from engine.pictures import decode_picture, encode_picture
from engine.scene import Gaussians
from engine.serve.downloads import DownloadFormat
from tests.conftest import ROOT

MakeGaussians = Callable[..., Gaussians]

WRITTEN = [one.name for one in FORMATS if one.write is not None]
RECORD = {"title": "Wedding vase 1906"}


@pytest.mark.parametrize("name", WRITTEN)
def test_each_format_holds_the_record_exactly_where_the_table_says_so(
    name: str, random_gaussians: MakeGaussians, tmp_path: Path
) -> None:
    kind = format_of(name)
    file = tmp_path / f"scene{kind.suffixes[-1]}"
    facts = FileFacts(extras=RECORD, comments=[f"title {RECORD['title']}"])
    write_scene(file, random_gaussians(50), name, facts, WritingTools(encode_picture))
    content = file.read_bytes()
    if name == "sog":
        with zipfile.ZipFile(file) as archive:
            content = archive.read("meta.json")
    assert (RECORD["title"].encode() in content) == kind.carries_record


@pytest.mark.parametrize("name", [one.name for one in FORMATS if one.write is not None and one.read is not None])
def test_each_format_that_is_written_and_read_is_recognised_and_moved_by_the_transform(
    name: str, random_gaussians: MakeGaussians, tmp_path: Path
) -> None:
    gaussians = random_gaussians(50)
    matrix = np.eye(4)
    matrix[:3, 3] = (1.0, 2.0, 3.0)
    file = tmp_path / "a file without its extension"
    write_scene(file, gaussians, name, FileFacts(matrix=matrix), WritingTools(encode_picture))
    assert kind_of(file) == name
    up = None if name == "glb" else "-y"
    back = read_other(file, name, decode_picture, up=up)
    middle = back.means.mean(0)
    expected = gaussians.means.mean(0) + matrix[:3, 3]
    # A PLY is read as it is, a SPZ is written with Y up: its middle may be turned, but is moved as far.
    assert abs(float(np.linalg.norm(middle)) - float(np.linalg.norm(expected))) < 0.05


def test_unknown_format_is_refused_with_the_names_of_the_others(
    random_gaussians: MakeGaussians, tmp_path: Path
) -> None:
    with pytest.raises(SettingsError, match="ply, spz, glb"):
        write_scene(tmp_path / "a.obj", random_gaussians(3), "obj", FileFacts(), WritingTools(encode_picture))
    with pytest.raises(SettingsError, match="ply, spz, glb"):
        write_scene(tmp_path / "a.splat", random_gaussians(3), "splat", FileFacts(), WritingTools(encode_picture))
    assert not list(tmp_path.iterdir())


def test_server_offers_what_can_be_written_and_blender_the_recommended_one_first() -> None:
    # An OBJ is three files.
    assert set(get_args(DownloadFormat)) == {*WRITTEN, "html", "mesh", "glb-mesh", "stl", "usd-mesh"}
    assert DEFAULT_FORMAT in WRITTEN


def test_docs_have_a_row_of_each_format() -> None:
    text = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    for one in FORMATS:
        suffixes = ", ".join(f"`{suffix}`" for suffix in (*one.suffixes, *one.read_suffixes))
        reads, writes = one.read is not None, one.write is not None or one.write_mesh is not None or one.is_page
        row = f"| {one.label} | {suffixes} | `{one.media_type}` | {_yes(reads)} | {_yes(writes)} |"
        row += f" {_yes(one.carries_record)} |"
        assert row in text, f"docs/formats.md has no row: {row}"


def _yes(value: bool) -> str:
    return "yes" if value else "no"


def test_no_other_file_of_the_product_lists_formats() -> None:
    names = {one.name for one in FORMATS} | {suffix for one in FORMATS for suffix in one.suffixes}
    found = []
    for folder in ("engine", "gaussian_heritage_addon", "operators"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            if path.parent.name == "formats":
                continue
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                listed = node.keys if isinstance(node, ast.Dict) else getattr(node, "elts", [])
                texts = {one.value for one in listed if isinstance(one, ast.Constant)}
                if len(texts & names) >= 2:
                    found.append(f"{path.relative_to(ROOT)}: {sorted(map(str, texts))}")
    assert not found
