"""pycolmap without its signal handlers.

Importing pycolmap installs glog's handlers, one of them for SIGTERM: it would print a stack trace and end the process
where the engine saves its work and stops. Modules of this package import pycolmap from here.
"""

from __future__ import annotations

import signal
import threading

import pycolmap

__all__ = ["pycolmap"]

if threading.current_thread() is threading.main_thread():
    # Python still knows its handler; setting it again puts it back in place of glog's.
    signal.signal(signal.SIGTERM, signal.getsignal(signal.SIGTERM))
