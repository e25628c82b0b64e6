"""Run the whole workflow, from photos to separate objects, in Blender: ``make demo``.

Builds the extension, installs it into a separate Blender without a window (bpy from PyPI), and calls its operators:
import the photo folder, isolate every prompt, export, save, render. Then the engine writes a package of each object,
which is verified, a mesh of each, and a page that shows the scene. Standard library only.

example: python scripts/demo.py --photos my/photos --prompts "vase, teapot"
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

from places import ROOT, python_of

DEFAULT_PHOTOS = ROOT / "demo" / "museum_room" / "photos"
DEFAULT_PROMPTS = "vase;teapot;obelisk;shield;mask;hourglass;goblet;drum"


def main() -> int:
    """Run the demo and return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--photos", type=Path, default=DEFAULT_PHOTOS, help="folder with photos (default: the museum room)"
    )
    parser.add_argument("--prompts", help=f'objects to isolate (default for the museum room: "{DEFAULT_PROMPTS}")')
    parser.add_argument("--preset", default="standard", help="preset of the settings (default: %(default)s)")
    parser.add_argument("--out", type=Path, help="folder for the results (default: out/<name of the photos>)")
    options = parser.parse_args()

    photos = options.photos.resolve()
    is_default = photos == DEFAULT_PHOTOS
    prompts = options.prompts if options.prompts is not None else (DEFAULT_PROMPTS if is_default else "")
    name = "museum_room" if is_default else (photos.parent.name if photos.name == "photos" else photos.name)
    out = (options.out or ROOT / "out" / name).resolve()

    engine, blender = python_of("engine"), python_of("blender-4.5")
    for python in (engine, blender):
        if not python.exists():
            print(f"{python} is missing. Run `make setup` first.", file=sys.stderr)
            return 1
    out.mkdir(parents=True, exist_ok=True)
    zip_file = out / "gaussian_heritage.zip"
    build = subprocess.run([blender, ROOT / "scripts" / "build_extension.py", "--out", zip_file], check=False)
    if build.returncode:
        return build.returncode
    environment = {
        **os.environ,
        "BLENDER_USER_RESOURCES": str(out / ".blender"),
        "GAUSSIAN_HERITAGE_PYTHON": str(engine),
    }
    command = [blender, "-P", ROOT / "scripts" / "demo_in_blender.py", zip_file, photos, out, prompts, options.preset]
    done = subprocess.run([str(part) for part in command], env=environment, cwd=out, check=False).returncode
    return done or keep(engine, out, name)


def keep(engine: Path, out: Path, name: str) -> int:
    """Write the page of the scene, a package and a mesh of each object, verify the packages; return the exit code."""
    project, page, packages = out / "project", out / f"{name}.html", out / "packages"
    has_objects = any((project / "objects").glob("*/object.json"))
    commands: list[list[object]] = [
        ["export", project, "--format", "html", "--out", page, "--overwrite"],
        ["package", project, *([] if has_objects else ["--scene"]), "--out", packages, "--overwrite"],
    ]
    for words in commands:
        if code := engine_command(engine, words):
            return code
    for package in sorted(file.parent for file in packages.glob("*/bagit.txt")):
        if code := engine_command(engine, ["verify", package]):
            return code
    meshes = out / "meshes"
    for record in sorted((project / "objects").glob("*/object.json")):
        name = record.parent.name
        file = meshes / f"{name}.glb"
        # An object may have no surface, such as one of glass; the engine says so, and the others have theirs.
        engine_command(
            engine, ["export", project, "--object", name, "--format", "glb-mesh", "--out", file, "--overwrite"]
        )
    print(f"  page            {page}\n  packages        {packages}\n  meshes          {meshes}")
    print(f"\nOpen first: {page}, in a browser. Turn the scene, and choose an object in the list.")
    print(f"Then {out / 'scene.blend'}, in Blender with the add-on {out / 'gaussian_heritage.zip'}.")
    return 0


def engine_command(engine: Path, words: list[object]) -> int:
    """Run a command of the engine and return its exit code."""
    command = [str(engine), "-m", "engine", *(str(word) for word in words)]
    return subprocess.run(command, cwd=ROOT, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
