"""What is measured in a real Blender window without a screen, with software OpenGL; see scripts/window_test.py."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..places import ROOT, python_of

# In the folder that `places` has made known.
from window_driver import Window  # isort: skip


class BlenderWindow:
    """A Blender window with the add-on, and the functions of `in_window`."""

    def __init__(self, work: Path, root: Path, sees: list[Path]) -> None:
        shutil.rmtree(work, ignore_errors=True)
        (work / "home").mkdir(parents=True)
        self._work = work
        self._window = Window(work, root, sees)
        zip_file = work / "home" / "gaussian_heritage.zip"
        command = [python_of("blender-4.5"), ROOT / "scripts" / "build_extension.py", "--out", zip_file]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        if not (root / "usr" / "bin" / "blender").exists():
            print("installing Blender into its own root (5 minutes)", flush=True)
            self._window.run("setup")
        self._window.start()
        self._window.python(
            f"bpy.ops.extensions.package_install_files(filepath={str(zip_file)!r}, repo='user_default',"
            " enable_on_install=True)"
        )
        self._window.python((Path(__file__).parent / "in_window.py").read_text(encoding="utf-8"))

    def __enter__(self) -> BlenderWindow:
        return self

    def __exit__(self, *_: Any) -> None:
        self._window.stop()

    @property
    def version(self) -> str:
        """Version of Blender, and what it draws with."""
        return self._window.python("print('.'.join(map(str, bpy.app.version)), gpu.platform.renderer_get(), sep=', ')")

    def open(self, project: Path) -> None:
        """Show a project in a new file."""
        self._window.python(
            "bpy.ops.wm.read_homefile(app_template='')\n"
            f"bpy.ops.heritage.open_project(directory={str(project)!r})\n"
            "bpy.ops.heritage.remove_default_objects()"
        )

    def call(self, function: str, *arguments: Any, **named: Any) -> Any:
        """Call a function of `in_window` and return what it prints, as JSON."""
        words = [*map(repr, arguments), *(f"{name}={value!r}" for name, value in named.items())]
        answer = self._window.python(f"{function}({', '.join(words)})", 600).splitlines()
        # Blender prints a line of its own for each redraw.
        return json.loads(answer[-1]) if answer else None

    def picture(self, photo: str, side: int, share: float) -> NDArray[np.float32]:
        """Return what the viewports draw of the view of a photo, sRGB values, shape [H, W, 3]."""
        file = self._work / "picture.npy"
        self.call("picture", photo, side, share, str(file))
        found: NDArray[np.float32] = np.load(file)
        return found

    def shot(self, file: Path) -> None:
        """Save the screen as PNG."""
        self._window.run("shot", file)
