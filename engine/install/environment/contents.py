"""The contents of an installation, for the user to read before it: packages, sizes and licences."""

from __future__ import annotations

from dataclasses import dataclass

DOWNLOAD_GB = {"cpu": 0.7, "cuda": 3.5}
"""Downloaded packages and model files, by build of torch, measured on Linux."""

DISK_GB = {"cpu": 2.6, "cuda": 8.0}
"""Free disk space that an installation needs, with pip's temporary files."""


@dataclass(frozen=True)
class Part:
    """Some of the packages of an installation, under one licence."""

    names: str
    licence: str


CONTENTS = (
    Part("PyTorch, pycolmap, SciPy, NumPy, scikit-learn", "BSD-3-Clause"),
    Part("Numba, llvmlite, wgpu", "BSD-2-Clause"),
    Part("ONNX Runtime", "MIT"),
    Part("OpenCV, tokenizers", "Apache-2.0"),
    Part("Pillow", "MIT-CMU"),
    Part("PyAV with FFmpeg, x264 and x265", "BSD-3-Clause, LGPL-3.0 and GPL-2.0-or-later"),
    Part("pillow-heif with libheif, libde265 and x265", "BSD-3-Clause, LGPL-3.0 and GPL-2.0-or-later"),
    Part("Matplotlib", "Matplotlib licence (BSD style)"),
)
"""The packages that do the work; those that they need have licences of the same kinds."""


def sizes(build: str) -> str:
    """Return download and disk space for a build of torch ("cpu" or "cuda") as text."""
    return f"about {DOWNLOAD_GB[build]:.1f} GB to download, {DISK_GB[build]:.1f} GB on the disk"
