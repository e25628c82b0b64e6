"""Open a URL by https and by nothing else, also after redirects.

Proxies are taken from the environment (``HTTPS_PROXY``, ``NO_PROXY``), as usual in Python. Certificates are those of
the system, or of ``SSL_CERT_FILE``.
"""

from __future__ import annotations

import http.client
import ssl
import string
import urllib.error
import urllib.request
from urllib.parse import quote, urljoin, urlsplit

from .errors import ModelFileError

__all__ = ["open_https"]

_TIMEOUT_SECONDS = 30.0
_MAX_REDIRECTS = 10
_REDIRECTS = (301, 302, 303, 307, 308)


def open_https(url: str, headers: dict[str, str]) -> http.client.HTTPResponse:
    """Return the response to a GET request; redirects are followed.

    Parameters
    ----------
    url : str
    headers : dict
        Sent with the request, and after a redirect to another host too; never put secrets into them.

    Raises
    ------
    ModelFileError
        When the URL, or one that it redirects to, is not https.
    OSError, http.client.HTTPException, ValueError
        When the network or the server fails, or a redirect leads to an address that is not valid.
    """
    # Not the default opener: it speaks http, ftp and file too, keeps the proxies of its first use, and reads the body
    # of a redirect, whatever its size.
    opener = urllib.request.OpenerDirector()
    for handler in (
        urllib.request.ProxyHandler(),
        urllib.request.HTTPSHandler(context=ssl.create_default_context()),
        urllib.request.HTTPErrorProcessor(),
        urllib.request.HTTPDefaultErrorHandler(),
    ):
        opener.add_handler(handler)
    address = url
    for _ in range(_MAX_REDIRECTS):
        if urlsplit(address).scheme != "https":
            leads_to = "" if address == url else f" redirects to {address[:200]!r}, which"
            raise ModelFileError(
                f"{url}{leads_to} is not an https address, so nothing was fetched from it: others could read or change "
                "the file on its way. Get it from a colleague and use `models fetch NAME --from FOLDER`."
            )
        try:
            response: http.client.HTTPResponse = opener.open(
                urllib.request.Request(address, headers=headers), timeout=_TIMEOUT_SECONDS
            )
            return response
        except urllib.error.HTTPError as error:
            location = error.headers.get("Location")
            if error.code not in _REDIRECTS or location is None:
                raise
            error.close()
            # As in urllib: headers are read as ISO-8859-1, and an address may have characters beyond ASCII.
            address = urljoin(address, quote(location, safe=string.punctuation, encoding="iso-8859-1"))
    raise http.client.HTTPException(f"more than {_MAX_REDIRECTS} redirects")
