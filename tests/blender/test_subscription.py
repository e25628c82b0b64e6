"""A real Blender subscribes to our extension repository, installs a version from it, and updates to the next one."""

from __future__ import annotations

import functools
import http.server
import json
import os
import re
import subprocess
import sys
import threading
import zipfile
from collections.abc import Iterator
from pathlib import Path

import bpy
import pytest

MANIFEST = "blender_manifest.toml"

IN_BLENDER = """
import importlib, json, os, sys
import bpy
address, action = sys.argv[1:]
if action == "update":
    bpy.ops.wm.read_userpref()  # as a Python module, Blender starts without them
preferences = bpy.context.preferences
repositories = preferences.extensions.repos
if action == "install":
    preferences.system.use_online_access = True
    repositories.new(name="Museum Tools", module="museum_tools", remote_url=address)
at = next(at for at, one in enumerate(repositories) if one.module == "museum_tools")
bpy.ops.extensions.repo_sync(repo_index=at)
if action == "install":
    bpy.ops.extensions.package_install(repo_index=at, pkg_id="gaussian_heritage", enable_on_install=True)
else:
    bpy.ops.extensions.package_upgrade_all()
bpy.ops.wm.save_userpref()
module = "bl_ext.museum_tools.gaussian_heritage"
with open(os.path.join(importlib.import_module(module).__path__[0], "blender_manifest.toml")) as stream:
    found = [module in preferences.addons, hasattr(bpy.types, "HERITAGE_OT_isolate"), stream.read()]
print("FOUND " + json.dumps(found), flush=True)
os._exit(0)  # Blender 4.5 as a Python module may not end.
"""


@pytest.fixture
def repository(tmp_path: Path) -> Iterator[tuple[Path, str]]:
    """Yield an empty folder and the address under which it is served."""
    folder = tmp_path / "repository"
    folder.mkdir()
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield folder, f"http://127.0.0.1:{server.server_address[1]}/index.json"
        server.shutdown()


def publish(folder: Path, zip_file: Path, version: str) -> None:
    """Replace the extension in a repository by `zip_file`, with another version in its manifest."""
    for old in folder.iterdir():
        old.unlink()
    with zipfile.ZipFile(zip_file) as source, zipfile.ZipFile(folder / f"gaussian_heritage-{version}.zip", "w") as new:
        for name in source.namelist():
            content = source.read(name)
            if name == MANIFEST:
                content = re.sub(rb'(?m)^version = ".*"$', f'version = "{version}"'.encode(), content)
            new.writestr(name, content, zipfile.ZIP_DEFLATED)
    tool = Path(bpy.utils.system_resource("SCRIPTS")) / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"
    command = [sys.executable, str(tool), "server-generate", "--repo-dir", str(folder)]
    subprocess.run(command, check=True, capture_output=True)


def in_blender(user: Path, *arguments: str) -> tuple[bool, bool, str]:
    """Return whether the add-on is enabled, whether its operators are there, and its version."""
    command = [sys.executable, "-P", "-c", IN_BLENDER, *arguments]
    environment = {**os.environ, "BLENDER_USER_RESOURCES": str(user)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, errors="replace", check=False)
    lines = [line for line in done.stdout.splitlines() if line.startswith("FOUND ")]
    assert lines, done.stdout + done.stderr
    is_enabled, has_operators, manifest = json.loads(lines[0].removeprefix("FOUND "))
    (version,) = re.findall(r'^version = "(.*)"$', manifest, re.MULTILINE)
    return is_enabled, has_operators, version


def test_subscriber_installs_a_version_and_is_given_the_next_one(
    repository: tuple[Path, str], zip_file: Path, tmp_path: Path
) -> None:
    folder, address = repository
    publish(folder, zip_file, "9.0.0")
    assert in_blender(tmp_path / "user", address, "install") == (True, True, "9.0.0")
    publish(folder, zip_file, "9.0.1")
    assert in_blender(tmp_path / "user", address, "update") == (True, True, "9.0.1")
