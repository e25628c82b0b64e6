"""The web server: photos uploaded from a browser, reconstructed here, objects out. Imported only by `commands`."""

from .accounts import Accounts
from .certificate import certificate_files
from .library import Library
from .run import run_server
from .settings import ServeSettings

__all__ = ["Accounts", "Library", "ServeSettings", "certificate_files", "run_server"]
