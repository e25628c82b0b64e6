"""A network that inspects encrypted connections: its certificate is named, and the system's certificates are used."""

from __future__ import annotations

import ssl
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from engine.core.certificates import system_context, untrusted_certificate
from engine.core.errors import EnvironmentProblem
from engine.core.https import open_https
from tests.engine.install.models.site import CERTIFICATE, Site, running_proxy, running_site

ISSUER = "Gaussian Heritage tests"


@pytest.fixture
def site(monkeypatch: pytest.MonkeyPatch) -> Iterator[Site]:
    """A server whose certificate nothing of this computer trusts, as one behind an inspecting firewall."""
    monkeypatch.delenv("SSL_CERT_FILE", raising=False)
    for name in ("HTTPS_PROXY", "https_proxy"):
        monkeypatch.delenv(name, raising=False)
    with running_site(b"content") as made:
        yield made


def test_certificate_that_is_not_trusted_is_named_with_what_to_do(site: Site) -> None:
    with pytest.raises(EnvironmentProblem) as told:
        open_https(f"https://127.0.0.1:{site.port}/file", {})
    for words in ("127.0.0.1", f"{ISSUER!r} issued", "IT department", "SSL_CERT_FILE", "offline bundle"):
        assert words in str(told.value), words
    assert site.requests == []


def test_file_of_the_it_department_is_trusted(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SSL_CERT_FILE", str(CERTIFICATE))
    with open_https(f"https://127.0.0.1:{site.port}/file", {}) as response:
        assert response.read() == b"content"


def test_certificate_is_seen_through_a_proxy_too(site: Site) -> None:
    with running_proxy(site.port) as proxy:
        sentence = untrusted_certificate("models.invalid", proxies={"https": f"http://127.0.0.1:{proxy.port}"})
        assert ISSUER in sentence and proxy.asked_for == ["models.invalid:443"]


def test_server_that_is_gone_meanwhile_leaves_a_sentence_without_a_name() -> None:
    sentence = untrusted_certificate("127.0.0.1", 9, proxies={})
    assert "127.0.0.1 is answered with a certificate, which this computer does not trust" in sentence


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (9, "certificate is not yet valid"),  # of OpenSSL
        (10, "certificate has expired"),
        # Of Windows, in the language of the user.
        (0x800B0101, "Ein erforderliches Zertifikat befindet sich nicht im Gültigkeitszeitraum."),
        (-67818, "“a.org” certificate is expired"),  # of macOS
    ],
)
def test_wrong_clock_is_told_apart_on_each_system(code: int, words: str) -> None:
    error = ssl.SSLCertVerificationError(words)
    error.verify_code, error.verify_message = code, words
    sentence = untrusted_certificate("a.org", error=error)
    assert "Check the date of this computer" in sentence and words.rstrip(".") + ")." in sentence


def test_server_without_a_certificate_is_told_without_a_code() -> None:
    # So truststore raises it on Windows.
    error = ssl.SSLCertVerificationError("Peer sent no certificates to verify")
    assert "does not trust: the network" in untrusted_certificate("127.0.0.1", 9, error=error, proxies={})


def test_certificates_are_those_of_the_operating_system_where_pip_has_truststore(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made: list[Path] = []

    class OfTheSystem(ssl.SSLContext):
        def load_verify_locations(self, cafile: object = None, *others: object) -> None:
            made.append(Path(str(cafile)))

    truststore = type("truststore", (), {"SSLContext": OfTheSystem})
    monkeypatch.setitem(sys.modules, "pip._vendor.truststore", truststore)
    monkeypatch.setenv("SSL_CERT_FILE", str(CERTIFICATE))
    assert isinstance(system_context(), OfTheSystem) and made == [CERTIFICATE]
    assert system_context().verify_mode is ssl.CERT_REQUIRED
