"""Open a URL by https and by nothing else, also after redirects.

Proxies are taken from the environment (``HTTPS_PROXY``, ``NO_PROXY``), as usual in Python. Certificates are those of
the system and of ``SSL_CERT_FILE``, see `certificates`. Another client's settings may say otherwise, see `Connection`.
"""

from __future__ import annotations

import http.client
import ssl
import string
import urllib.error
import urllib.request
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote, urljoin, urlsplit

from .certificates import system_context, untrusted_certificate
from .errors import EnvironmentProblem, ModelFileError

_TIMEOUT_SECONDS = 30.0
_MAX_REDIRECTS = 10
_REDIRECTS = (301, 302, 303, 307, 308)


@dataclass(frozen=True)
class Connection:
    """How servers are reached.

    Attributes
    ----------
    certificates : tuple of Path
        Files with certificates that are trusted beside those of the system. Those that do not exist are left out.
    proxy : str
        URL of a proxy; empty for that of the environment.
    no_proxy : str
        Hosts that are asked without it, divided by commas.
    verify : bool
        Whether a server must prove who it is. False only for files whose content is checked by a known hash.
    plain_http : bool
        Whether http is allowed too, for such files alone.
    """

    certificates: tuple[Path, ...] = ()
    proxy: str = ""
    no_proxy: str = ""
    verify: bool = True
    plain_http: bool = False

    def context(self) -> ssl.SSLContext:
        """Return the settings of TLS; raises `OSError` when a file of certificates cannot be read."""
        context = system_context()
        for file in self.certificates:
            if file.is_file():
                context.load_verify_locations(file)
        if not self.verify:
            context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        return context

    def proxies(self, host: str) -> dict[str, str] | None:
        """Return the proxies for a host by scheme; None for those of the environment."""
        if not self.proxy:
            return None
        without = (name.strip().lstrip(".") for name in self.no_proxy.split(","))
        if any(name and (host == name or host.endswith(f".{name}")) for name in without):
            return {}
        return {"https": self.proxy, "http": self.proxy}


def open_https(
    url: str,
    headers: Mapping[str, str],
    *,
    secrets: Mapping[str, str] | None = None,
    connection: Connection | None = None,
) -> http.client.HTTPResponse:
    """Return the response to a GET request; redirects are followed.

    Parameters
    ----------
    headers : mapping
        Sent with the request, and after a redirect to another host too; never put secrets into them.
    secrets : mapping, optional
        Headers that only the host of `url` gets.
    connection : Connection, optional
        By default, that of the environment.

    Raises
    ------
    ModelFileError
        When the URL, or one that it redirects to, is not https.
    EnvironmentProblem
        When the certificate of the server is not trusted, as in networks that inspect encrypted connections.
    OSError, http.client.HTTPException, ValueError
        When the network or the server fails, or a redirect leads to an address that is not valid.
    """
    # Not the default opener: it speaks http, ftp and file too, keeps the proxies of its first use, and reads the body
    # of a redirect, whatever its size.
    connection = connection or Connection()
    opener = urllib.request.OpenerDirector()
    for handler in (
        urllib.request.ProxyHandler(connection.proxies(urlsplit(url).hostname or "")),
        urllib.request.HTTPSHandler(context=connection.context()),
        urllib.request.HTTPErrorProcessor(),
        urllib.request.HTTPDefaultErrorHandler(),
        *([urllib.request.HTTPHandler()] if connection.plain_http else []),
    ):
        opener.add_handler(handler)
    schemes = ("https", "http") if connection.plain_http else ("https",)
    address = url
    for _ in range(_MAX_REDIRECTS):
        if urlsplit(address).scheme not in schemes:
            leads_to = "" if address == url else f" redirects to {address[:200]!r}, which"
            raise ModelFileError(
                f"{url}{leads_to} is not an https address, so nothing was fetched from it: others could read or change "
                "the file on its way. Get it from a colleague and use `models fetch NAME --from FOLDER`."
            )
        sent = {**headers, **(secrets or {})} if urlsplit(address).netloc == urlsplit(url).netloc else dict(headers)
        try:
            response: http.client.HTTPResponse = opener.open(
                urllib.request.Request(address, headers=sent), timeout=_TIMEOUT_SECONDS
            )
            return response
        except urllib.error.HTTPError as error:
            location = error.headers.get("Location")
            if error.code not in _REDIRECTS or location is None:
                raise
            error.close()
            # As in urllib: headers are read as ISO-8859-1, and an address may have characters beyond ASCII.
            address = urljoin(address, quote(location, safe=string.punctuation, encoding="iso-8859-1"))
        except urllib.error.URLError as error:
            if not isinstance(error.reason, ssl.SSLCertVerificationError):
                raise
            parts = urlsplit(address)
            sentence = untrusted_certificate(
                parts.hostname or "", parts.port or 443, error=error.reason,
                proxies=connection.proxies(parts.hostname or ""),
            )  # fmt: skip
            raise EnvironmentProblem(sentence) from error
    raise http.client.HTTPException(f"more than {_MAX_REDIRECTS} redirects")
