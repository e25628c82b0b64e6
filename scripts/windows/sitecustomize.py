r"""Gaps of Wine: the limit of 260 characters of a path, locked files, and certificates of servers.

Where another process has locked a file, `msvcrt.locking` fails with the error 0 under Wine, with EACCES on Windows.

Windows' check of a certificate, which truststore asks, takes roots of the caller and addresses of IP. Wine's knows the
settings of own roots in their size before Windows 8 only, and compares no address with those in a certificate.

This file lies in the library of Windows' Python, so all this holds in every process, also below a virtual environment
and with the option ``-I``. Environment variable WINTEST_MAX_PATH: the longest path with the zero at its end (260 on
Windows, unless long paths were enabled), 0 or missing for no limit. As on Windows, paths that begin with ``\\?\`` are
not limited, and a folder needs 12 characters more. Native code of packages is not limited.
"""

from __future__ import annotations

import errno
import importlib.machinery
import msvcrt
import os
import sys

TYPE_CHECKING = False  # without `typing`, whose import every process would wait for
if TYPE_CHECKING:
    import types
    from collections.abc import Callable
    from typing import Any

_EVENTS = {
    "open", "os.listdir", "os.scandir", "os.mkdir", "os.remove", "os.rename", "os.rmdir", "os.truncate", "os.utime",
    "os.link", "os.symlink", "os.chdir", "os.chmod",
}  # fmt: skip
_PLACES = 2
"""Arguments of an event that can be paths: os.rename, os.link and os.symlink have two."""
_LOOKING = ("stat", "lstat", "readlink", "access")
_ROOM_OF_A_FOLDER = 12
_NOT_FOUND, _TOO_LONG = 3, 206


def _install(max_path: int) -> None:
    full_path = __import__("nt")._getfullpathname

    def check(path: object, room: int = 0) -> None:
        try:
            text = os.fsdecode(path)  # type: ignore[arg-type]
        except TypeError:  # a number of an open file, or none
            return
        if not text or text.startswith(("\\\\?\\", "\\\\.\\")):
            return
        try:
            length = len(full_path(text)) + 1
        except (OSError, ValueError):
            return
        if length + room > max_path:
            code = _TOO_LONG if room else _NOT_FOUND
            raise OSError(2, "The path is too long (simulated limit of Windows)", text, code)

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        if event not in _EVENTS:
            return
        if event == "open" and not isinstance(arguments[0], (str, bytes)):
            return
        for argument in arguments[: _PLACES if event in ("os.rename", "os.link", "os.symlink") else 1]:
            check(argument, _ROOM_OF_A_FOLDER if event == "os.mkdir" else 0)

    sys.addaudithook(hook)
    # These raise no event of an audit.
    for name in _LOOKING:
        own = getattr(os, name)

        def limited(path: object, *arguments: object, _own: object = own, **options: object) -> object:
            check(path)
            return _own(path, *arguments, **options)  # type: ignore[operator]

        limited.__name__ = name
        setattr(os, name, limited)
        os.supports_fd.add(limited) if own in os.supports_fd else None
        os.supports_follow_symlinks.add(limited) if own in os.supports_follow_symlinks else None


_lock = msvcrt.locking  # type: ignore[attr-defined]


def _locking(file: int, mode: int, n_bytes: int) -> None:
    try:
        _lock(file, mode, n_bytes)
    except OSError as error:
        if error.errno:
            raise
        raise PermissionError(errno.EACCES, "Permission denied") from error


msvcrt.locking = _locking  # type: ignore[attr-defined]


class _Certificates:
    """Loads truststore's module for Windows, also that in pip, and closes the gaps of Wine in it."""

    def find_spec(self, name: str, path: object = None, target: object = None) -> object:
        if not name.endswith("truststore._windows"):
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path, target)  # type: ignore[arg-type]
        if spec is not None and spec.loader is not None:
            own = spec.loader.exec_module
            spec.loader.exec_module = lambda module: _check_addresses(module, own)  # type: ignore[method-assign]
        return spec


def _check_addresses(module: types.ModuleType, load: Callable[[types.ModuleType], None]) -> None:
    import ctypes
    import ipaddress
    import ssl

    load(module)
    create, verify = module.CertCreateCertificateChainEngine, module._get_and_verify_cert_chain

    def create_engine(settings: Any, engine: object) -> object:
        settings.contents.cbSize = module.CERT_CHAIN_ENGINE_CONFIG.dwExclusiveFlags.offset
        return create(settings, engine)

    def verify_chain(
        context: Any, engine: object, store: object, certificate: Any, parameters: object, host: str | None,
        chain_flags: int,
    ) -> None:  # fmt: skip
        try:
            address = ipaddress.ip_address(host or "").packed
        except ValueError:
            verify(context, engine, store, certificate, parameters, host, chain_flags)
            return
        verify(context, engine, store, certificate, parameters, None, chain_flags)
        shown = ctypes.string_at(certificate.contents.pbCertEncoded, certificate.contents.cbCertEncoded)
        # Among the names in a certificate, 0x87 and the length come before an address.
        if context.check_hostname and bytes((0x87, len(address))) + address not in shown:
            error = ssl.SSLCertVerificationError(_OTHER_NAME)
            error.verify_message, error.verify_code = _OTHER_NAME, _CERT_E_CN_NO_MATCH
            raise error

    module.CertCreateCertificateChainEngine = create_engine  # type: ignore[attr-defined]
    module._get_and_verify_cert_chain = verify_chain  # type: ignore[attr-defined]


_OTHER_NAME, _CERT_E_CN_NO_MATCH = "The certificate's CN name does not match the passed value.", 0x800B010F
sys.meta_path.insert(0, _Certificates())

if _max_path := int(os.environ.get("WINTEST_MAX_PATH") or 0):
    _install(_max_path)
