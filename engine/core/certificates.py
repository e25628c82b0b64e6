"""Certificates of servers: which are trusted, and a sentence about one that is not.

Networks of museums and universities often inspect encrypted connections: a firewall answers in place of each server,
with a certificate of its own. Standard library only; where pip is at hand, its truststore reads the system's.
"""

from __future__ import annotations

import http.client
import importlib
import os
import ssl
import tempfile
import urllib.request
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

CERTIFICATE_VARIABLE = "SSL_CERT_FILE"
"""Environment variable with a file of certificates that are trusted, as OpenSSL has it."""
_OUT_OF_DATE = {9, 10, 0x800B0101, -67818, -67819}
"""Codes of a certificate that is not valid now: of OpenSSL, Windows and macOS. The last two translate their words."""
_SECONDS = 15.0
_MAX_NAME = 200


def system_context() -> ssl.SSLContext:
    """Return settings of TLS that trust what the operating system trusts, and the file of ``SSL_CERT_FILE``.

    Raises
    ------
    OSError
        When that file cannot be read.
    """
    try:
        # Python alone does not read the keychain of macOS, nor what Windows fetches only when it is needed.
        truststore: Any = importlib.import_module("pip._vendor.truststore")
    except ImportError:
        return ssl.create_default_context()
    context: ssl.SSLContext = truststore.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    if file := os.environ.get(CERTIFICATE_VARIABLE):
        context.load_verify_locations(file)
    return context


def untrusted_certificate(
    host: str, port: int = 443, *, error: ssl.SSLCertVerificationError | None = None,
    proxies: Mapping[str, str] | None = None,
) -> str:  # fmt: skip
    """Return a sentence about a server whose certificate is not trusted: who issued it, and what to do.

    Parameters
    ----------
    error : SSLCertVerificationError, optional
        What OpenSSL or the system said.
    proxies : mapping, optional
        Proxies by scheme; by default those of the environment. Used to look at the certificate.
    """
    # That of truststore has neither where a server showed no certificate.
    why = str(getattr(error, "verify_message", "")).rstrip(".")
    if getattr(error, "verify_code", 0) in _OUT_OF_DATE:
        return f"The certificate of {host} is not valid now ({why}). Check the date of this computer, and try again."
    issuer = _issuer(host, port, urllib.request.getproxies() if proxies is None else proxies)
    named = f"a certificate that {issuer!r} issued" if issuer else "a certificate"
    reason = f" ({why})" if why else ""
    return (
        f"{host} is answered with {named}, which this computer does not trust{reason}: the network inspects encrypted "
        "connections. Ask the IT department to install the certificate of its issuer in the system of this computer, "
        f"or to give you its file (PEM); then name the file in the environment variable {CERTIFICATE_VARIABLE}, start "
        "the program again, and try again. Without that, use an offline bundle."
    )


def _issuer(host: str, port: int, proxies: Mapping[str, str]) -> str:
    """Return the name of who issued the certificate that a connection to `host` shows; empty when none is shown."""
    # Nothing is sent to or read from this connection.
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    proxy = urlsplit(proxies.get("https", ""))
    try:
        if proxy.hostname and not urllib.request.proxy_bypass(host):
            connection = http.client.HTTPSConnection(
                proxy.hostname, proxy.port or 8080, timeout=_SECONDS, context=context
            )
            connection.set_tunnel(host, port)
        else:
            connection = http.client.HTTPSConnection(host, port, timeout=_SECONDS, context=context)
        try:
            connection.connect()
            shown = connection.sock.getpeercert(binary_form=True)
        finally:
            connection.close()
        return _issuer_in(shown) if shown else ""
    except (OSError, http.client.HTTPException, ValueError):
        return ""


def _issuer_in(certificate: bytes) -> str:
    # The only decoder of certificates in the standard library reads files, and has no public name.
    decode: Any = getattr(ssl, "_ssl", None)
    if not hasattr(decode, "_test_decode_cert"):
        return ""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "certificate.pem"
        file.write_text(ssl.DER_cert_to_PEM_cert(certificate), encoding="ascii")
        issuer = decode._test_decode_cert(str(file)).get("issuer", ())
    names = {key: value for part in issuer for key, value in part}
    found = names.get("commonName") or names.get("organizationName") or ""
    return str(found)[:_MAX_NAME]
