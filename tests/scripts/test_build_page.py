"""`make page` trusts the certificates that the engine trusts."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"


def test_npm_trusts_the_file_of_certificates_that_the_user_names(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(SCRIPTS))
    trusting = importlib.import_module("build_page").trusting
    assert "NODE_EXTRA_CA_CERTS" not in trusting({"PATH": "a"})
    variables = trusting({"PATH": "a", "SSL_CERT_FILE": "museum.pem"})
    assert variables["NODE_EXTRA_CA_CERTS"] == "museum.pem" and variables["PATH"] == "a"
    # What the user has said about Node stays.
    kept = trusting({"SSL_CERT_FILE": "museum.pem", "NODE_EXTRA_CA_CERTS": "own.pem", "NODE_USE_SYSTEM_CA": "0"})
    assert (kept["NODE_EXTRA_CA_CERTS"], kept["NODE_USE_SYSTEM_CA"]) == ("own.pem", "0")
