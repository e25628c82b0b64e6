"""What the measuring run asks git: the present commit, uncommitted changes, earlier versions, and worktrees."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path

from engine.core.errors import EnvironmentProblem, ProjectError


class Repository:
    """A git repository.

    Parameters
    ----------
    root : Path
        Folder of the working tree.
    """

    def __init__(self, root: Path) -> None:
        self.root = root

    def head(self) -> str:
        """Return the full hash of the present commit; raises as `full_commit` does."""
        return self.full_commit("HEAD")

    def full_commit(self, name: str) -> str:
        """Return the full hash of a commit.

        Raises
        ------
        EnvironmentProblem
            When git is not installed.
        ProjectError
            When there is no such commit, or no repository.
        """
        answer = self._git("rev-parse", "--verify", "--quiet", "--end-of-options", f"{name}^{{commit}}")
        if answer.returncode:
            self._require_repository()
            raise ProjectError(f"The repository {self.root} has no commit {name!r}. Fetch it, or name another one.")
        return answer.stdout.strip()

    def has_history(self) -> bool:
        """Return whether the folder is the root of a git repository with commits; False also without git."""
        try:
            top = self._git("rev-parse", "--show-toplevel") if self.root.is_dir() else None
            return (
                top is not None
                and top.returncode == 0
                and Path(top.stdout.strip()).resolve() == self.root.resolve()
                and self._git("rev-parse", "--verify", "HEAD").returncode == 0
            )
        except EnvironmentProblem:
            return False

    def changed(self, folders: Sequence[str] = (".",), *, without: Sequence[str] = ()) -> list[str]:
        """Return the files in `folders`, except those in the folders `without`, whose changes are not committed."""
        options = ("--porcelain=v1", "-z", "--untracked-files=all", "--no-renames")
        answer = self._required("status", *options, "--", *folders)
        files = (entry[3:] for entry in answer.split("\0") if entry)
        return [file for file in files if not file.startswith(tuple(f"{folder}/" for folder in without))]

    def versions_of(self, file: Path) -> Iterator[tuple[str, str | None]]:
        """Yield each commit that changed a file, the newest first, with the text that the file had; None if deleted."""
        answer = self._required("log", "--follow", "--name-only", "-z", "--format=commit %H", "--", file.as_posix())
        commit = ""
        for word in filter(None, (part.strip() for part in answer.replace("\n", "\0").split("\0"))):
            if word.startswith("commit "):
                commit = word.removeprefix("commit ")
                continue
            shown = self._git("show", f"{commit}:{word}")
            yield commit, shown.stdout if shown.returncode == 0 else None

    def worktree(self, folder: Path, commit: str) -> Path:
        """Return `folder` as a worktree of `commit`, made when missing, incomplete or changed.

        Raises
        ------
        ProjectError
            When git cannot make it.
        """
        there = Repository(folder)
        if there.has_history() and there.head() == commit and not there.changed():
            return folder
        if folder.exists():
            # Twice --force: also one that a killed run left locked.
            self._git("worktree", "remove", "--force", "--force", str(folder))
        if folder.exists():
            raise ProjectError(f"{folder} is in the way of a worktree of the commit {commit[:12]}. Delete it.")
        folder.parent.mkdir(parents=True, exist_ok=True)
        self._required("worktree", "add", "--force", "--force", "--detach", str(folder), commit)
        return folder

    def _required(self, *arguments: str) -> str:
        answer = self._git(*arguments)
        if answer.returncode:
            self._require_repository()
            reason = (answer.stderr.strip().splitlines() or ["no reason given"])[-1]
            raise ProjectError(f"git {arguments[0]} failed in {self.root}: {reason}. Repair that, then run again.")
        return answer.stdout

    def _require_repository(self) -> None:
        if self._git("rev-parse", "--git-dir").returncode:
            raise ProjectError(
                f"{self.root} is not a git repository with commits. Use a clone, not an unpacked archive."
            )

    def _git(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        # Variables such as GIT_DIR, which a git hook sets, would lead to another repository.
        environment = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
        try:
            return subprocess.run(
                ["git", "-c", f"core.hooksPath={os.devnull}", *arguments],
                cwd=self.root,
                env={**environment, "LC_ALL": "C"},
                capture_output=True,
                encoding="utf-8",
                errors="replace",
                check=False,
            )
        except FileNotFoundError as error:
            raise EnvironmentProblem("git is not installed, or not on the PATH. Install it, then run again.") from error
