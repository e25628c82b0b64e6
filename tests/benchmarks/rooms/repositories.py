"""A small git repository with the folders that a frozen method consists of."""

from __future__ import annotations

import atexit
import functools
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from benchmarks.rooms.draws import DRAWS_FILE
from benchmarks.rooms.repository import Repository


def git(folder: Path, *arguments: str) -> str:
    """Run git as a user without settings of her own, and return what it prints."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    environment |= {"GIT_CONFIG_GLOBAL": os.devnull, "GIT_CONFIG_SYSTEM": os.devnull}
    command = ["git", "-c", "user.name=a", "-c", "user.email=a@example.org", *arguments]
    return subprocess.run(
        command, cwd=folder, env=environment, check=True, capture_output=True, text=True
    ).stdout.strip()


def commit(repository: Repository, file: str, text: str) -> str:
    """Commit a file and return the hash of the commit."""
    path = repository.root / file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    git(repository.root, "add", "--all")
    git(repository.root, "commit", "--quiet", "--message", f"Change {file}")
    return repository.head()


@functools.cache
def _template() -> Path:
    """Return a repository with one commit, made once: git is slow."""
    folder = Path(tempfile.mkdtemp(prefix="heritage-rooms-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    git(folder, "init", "--quiet")
    (folder / ".gitignore").write_text("out/\n", encoding="utf-8")
    for part in ("engine", "demo"):
        (folder / part).mkdir()
        (folder / part / "code.py").write_text("METHOD = 1\n", encoding="utf-8")
    commit(Repository(folder), DRAWS_FILE.as_posix(), "[]\n")
    return folder


def make_repository(folder: Path) -> Repository:
    """Return a repository with one commit and without draws."""
    return Repository(Path(shutil.copytree(_template(), folder)))
