"""A server for weight files."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from engine.install.models.cache import OFFLINE_VARIABLE
from tests.engine.install.models.site import CERTIFICATE, CONTENT, Site, running_site


@pytest.fixture
def site(monkeypatch: pytest.MonkeyPatch) -> Iterator[Site]:
    """A server of `CONTENT` whose certificate is trusted and that is reached without a proxy."""
    for name in ("https_proxy", "HTTPS_PROXY", "no_proxy", "NO_PROXY", "all_proxy", "ALL_PROXY", OFFLINE_VARIABLE):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("SSL_CERT_FILE", str(CERTIFICATE))
    with running_site(CONTENT) as made:
        yield made
