"""Build the page of the web server with npm, into ``engine/serve/page/dist``, and the page of exported scenes.

Nothing is done when both are up to date. The second goes into ``engine/packages/viewer_files``.

Runs in the engine's environment: ``make page`` calls it.

example: python scripts/build_page.py
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from places import ROOT

sys.path.insert(0, str(ROOT))
from engine.errors import HeritageError  # noqa: E402
from engine.events import never_stop  # noqa: E402
from engine.models import npm_command  # noqa: E402

PAGE = ROOT / "engine" / "serve" / "page"
STAMP = PAGE / "dist" / "made_from.txt"
SHOWN = ROOT / "engine" / "packages" / "viewer_files" / "show.js"


def main() -> int:
    """Build the page and return 0, or print the problem and return 1."""
    made_from = fingerprint()
    if STAMP.is_file() and SHOWN.is_file() and STAMP.read_text() == made_from:
        print("The page is up to date.")
        return 0
    try:
        with tempfile.TemporaryDirectory() as folder:
            npm = npm_command(Path(folder), never_stop)
            # Programs that npm starts look for node in PATH.
            path = os.pathsep.join([str(Path(npm[0]).parent), os.environ["PATH"]])
            for words in (["ci", "--ignore-scripts", "--no-audit", "--no-fund"], ["run", "build"]):
                done = subprocess.run([*npm, *words], cwd=PAGE, env={**os.environ, "PATH": path}, check=False)
                if done.returncode:
                    print(f"\nnpm {' '.join(words)} failed (see above). Check the network, then run it again.")
                    return 1
    except HeritageError as problem:
        print(f"\nThe page was not built: {problem}", file=sys.stderr)
        return 1
    STAMP.write_text(made_from)
    return 0


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
