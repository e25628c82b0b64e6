"""Whether the server of a data folder answers: the health check of containers."""

from __future__ import annotations

import http.client
import ssl
from http import HTTPStatus

from ..core.errors import EnvironmentProblem
from .settings import ServeSettings

_HOST = "127.0.0.1"
_PATH = "/api/v1/session"
_SECONDS = 8.0


def check_server(settings: ServeSettings) -> None:
    """Ask the server once.

    Parameters
    ----------
    settings : ServeSettings
        Those of the server: its data, its port, and whether it uses TLS.

    Raises
    ------
    EnvironmentProblem
        When it does not answer, or its certificate is not that of the data folder.
    """
    connection = http.client.HTTPConnection(_HOST, settings.port, timeout=_SECONDS)
    try:
        if settings.lan:
            context = ssl.create_default_context(cafile=settings.data / "certificate.pem")
            connection = http.client.HTTPSConnection(_HOST, settings.port, timeout=_SECONDS, context=context)
        connection.request("GET", _PATH)
        status = connection.getresponse().status
    except (OSError, http.client.HTTPException) as error:
        raise EnvironmentProblem(f"The server on port {settings.port} does not answer: {error}.") from error
    finally:
        connection.close()
    if status != HTTPStatus.OK:
        raise EnvironmentProblem(f"The server on port {settings.port} answers with status {status}.")
