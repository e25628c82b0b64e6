"""The engine of Gaussian Heritage: photos in, Gaussians and separate objects out.

It runs in its own process and its own Python environment (``python -m engine``) and never imports ``bpy``.
Data flows one way: photos -> cameras -> masks -> gaussians (training) -> objects (grounding) -> formats.
"""

__version__ = "0.2.0"
"""The only statement of the version; scripts/build_extension.py writes it into the extension's manifest."""
