"""pycolmap without its signal handlers.

Importing pycolmap installs glog's handlers, one of them for SIGTERM: it would print a stack trace and end the process
where the engine saves its work and stops. Modules of this package import pycolmap from here.
"""

from __future__ import annotations

from ..core.system import handlers_kept

with handlers_kept():
    import pycolmap as pycolmap
