"""Weight files from a URL: resumed downloads, proxies, offline folders, and trust on first use."""

from __future__ import annotations

import hashlib
import json
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from engine.errors import Cancelled, DiskError, EnvironmentProblem, ModelFileError
from engine.events import Event, Progress
from engine.models import download as download_module
from engine.models.cache import OFFLINE_VARIABLE, locate
from engine.models.catalogue import CATALOGUE, ModelFile
from engine.models.fetching import fetch
from engine.models.verification import record_path

CONTENT = bytes(range(256)) * 4000  # 1 MB


@dataclass
class Site:
    """A server of one file that can interrupt a download, ignore ranges, or serve another file."""

    content: bytes = CONTENT
    etag: str | None = '"one"'
    breaks_after: int | None = None
    ranges: bool = True
    port: int = 0
    requests: list[tuple[str, str | None]] = field(default_factory=list)

    def answer(self, handler: BaseHTTPRequestHandler) -> None:
        wanted = handler.headers.get("Range")
        self.requests.append((handler.path, wanted))
        if "gone" in handler.path:
            handler.send_error(404)
            return
        start = int(wanted[6:-1]) if wanted and self.ranges else 0
        if wanted and handler.headers.get("If-Range", self.etag) != self.etag:
            start = 0
        if start >= len(self.content):
            handler.send_error(416)
            return
        body = self.content[start:]
        handler.send_response(206 if start else 200)
        if start:
            handler.send_header("Content-Range", f"bytes {start}-{len(self.content) - 1}/{len(self.content)}")
        if self.etag:
            handler.send_header("ETag", self.etag)
        handler.send_header("Content-Length", str(len(body)))
        handler.end_headers()
        handler.wfile.write(body if self.breaks_after is None else body[: self.breaks_after])


@pytest.fixture
def site(monkeypatch: pytest.MonkeyPatch) -> Iterator[Site]:
    made = Site()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            made.answer(self)

        def log_message(self, format: str, *arguments: object) -> None:
            pass

    for name in ("http_proxy", "HTTP_PROXY", "no_proxy", "NO_PROXY", OFFLINE_VARIABLE):
        monkeypatch.delenv(name, raising=False)
    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    made.port = server.server_address[1]
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    yield made
    server.shutdown()
    thread.join()
    server.server_close()


def _model(
    monkeypatch: pytest.MonkeyPatch, site: Site, *, known: bool, host: str = "", path: str = "rev/large.onnx"
) -> ModelFile:
    digest = hashlib.sha256(CONTENT).hexdigest() if known else None
    source = f"http://{host or f'127.0.0.1:{site.port}'}/{path}"
    size = len(CONTENT) if known else None
    model = ModelFile("large", source, "", "large.onnx", size, digest, "MIT", "anyone", optional=True)
    monkeypatch.setitem(CATALOGUE, "large", model)
    return model


def _files(cache: Path) -> set[str]:
    return {path.name for path in (cache / "models").iterdir()}


@pytest.mark.parametrize("known", [True, False], ids=["hash-in-the-table", "trusted-on-first-use"])
def test_interrupted_download_is_resumed_where_it_stopped(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch, known: bool
) -> None:
    _model(monkeypatch, site, known=known)
    site.breaks_after = 300_000
    with pytest.raises(EnvironmentProblem, match=r"broke after 300,000 of 1,024,000 bytes.*run the same command again"):
        fetch("large", cache=tmp_path)
    assert (tmp_path / "models" / "large.onnx.part").stat().st_size == 300_000
    site.breaks_after = None
    assert fetch("large", cache=tmp_path).read_bytes() == CONTENT
    assert [wanted for _, wanted in site.requests] == [None, "bytes=300000-"]
    assert _files(tmp_path) == {"large.onnx"} | (set() if known else {"large.onnx.trusted.json"})


def test_partial_download_of_a_file_that_changed_on_the_server_is_discarded(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    _model(monkeypatch, site, known=False)
    site.breaks_after = 300_000
    with pytest.raises(EnvironmentProblem):
        fetch("large", cache=tmp_path)
    site.breaks_after, site.content, site.etag = None, CONTENT[::-1], '"two"'
    assert fetch("large", cache=tmp_path).read_bytes() == CONTENT[::-1]


def test_download_from_a_server_without_ranges_or_etags_starts_again(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    _model(monkeypatch, site, known=False)
    site.breaks_after, site.etag, site.ranges = 300_000, None, False
    with pytest.raises(EnvironmentProblem):
        fetch("large", cache=tmp_path)
    site.breaks_after = None
    assert fetch("large", cache=tmp_path).read_bytes() == CONTENT
    assert [wanted for _, wanted in site.requests] == [None, None]


def test_partial_file_longer_than_the_file_is_discarded(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    _model(monkeypatch, site, known=True)
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "large.onnx.part").write_bytes(CONTENT + b"more")
    assert fetch("large", cache=tmp_path).read_bytes() == CONTENT


def test_file_that_differs_from_the_catalogue_leaves_nothing_in_the_cache(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    _model(monkeypatch, site, known=True)
    site.content = CONTENT[::-1]
    with pytest.raises(ModelFileError, match="is not the file listed in the catalogue"):
        fetch("large", cache=tmp_path)
    assert _files(tmp_path) == set()


def test_hash_of_the_first_use_is_recorded_and_enforced(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = _model(monkeypatch, site, known=False)
    assert model.pin == "pinned by revision; hash is written on first fetch and checked afterwards"
    path = fetch("large", cache=tmp_path)
    record = json.loads(record_path(path).read_text())
    assert record == {"size": len(CONTENT), "sha256": hashlib.sha256(CONTENT).hexdigest(), "source": model.source}
    path.write_bytes(CONTENT[:-1] + b"x")
    with pytest.raises(ModelFileError, match="is damaged .*first use"):
        locate("large", tmp_path)
    assert fetch("large", cache=tmp_path).read_bytes() == CONTENT
    path.unlink()
    site.content = CONTENT[::-1]
    with pytest.raises(ModelFileError, match="is not the file that was trusted on first use"):
        fetch("large", cache=tmp_path)
    assert not path.exists()
    record_path(path).write_text("{")
    path.write_bytes(CONTENT)
    with pytest.raises(ModelFileError, match="record .* cannot be read"):
        locate("large", tmp_path)


def test_file_copied_into_the_cache_by_hand_is_neither_trusted_nor_deleted(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    _model(monkeypatch, site, known=False)
    path = tmp_path / "models" / "large.onnx"
    path.parent.mkdir()
    path.write_bytes(CONTENT)
    with pytest.raises(ModelFileError, match="copied here by hand"):
        locate("large", tmp_path)
    with pytest.raises(ModelFileError, match="fetch large --from FOLDER"):
        fetch("large", cache=tmp_path)
    assert path.read_bytes() == CONTENT and not site.requests


def test_proxy_of_the_environment_is_used(tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    _model(monkeypatch, site, known=True, host="models.invalid")
    monkeypatch.setenv("http_proxy", f"http://127.0.0.1:{site.port}")
    assert fetch("large", cache=tmp_path).read_bytes() == CONTENT
    assert site.requests[0][0] == "http://models.invalid/rev/large.onnx"


def test_errors_of_network_and_url_say_what_to_do(tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    _model(monkeypatch, site, known=True, host="127.0.0.1:9")
    with pytest.raises(EnvironmentProblem, match="Could not download large .* set HTTPS_PROXY; .* --from FOLDER"):
        fetch("large", cache=tmp_path)
    _model(monkeypatch, site, known=True, path="gone/large.onnx")
    with pytest.raises(ModelFileError, match="no longer at http.*Get large.onnx from a colleague"):
        fetch("large", cache=tmp_path)


def test_cancel_keeps_the_partial_download_and_progress_is_reported(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    _model(monkeypatch, site, known=True)
    monkeypatch.setattr(download_module, "_PROGRESS_INTERVAL_SECONDS", 0.0)
    events: list[Event] = []
    with pytest.raises(Cancelled, match="the next fetch continues there"):
        fetch("large", cache=tmp_path, should_stop=lambda: len(events) > 2, emit=events.append)
    assert 0 < (tmp_path / "models" / "large.onnx.part").stat().st_size < len(CONTENT)
    fetch("large", cache=tmp_path, emit=events.append)
    fractions = [event.fraction for event in events if isinstance(event, Progress)]
    assert fractions[-1] == 1.0 and any(0 < fraction < 1 for fraction in fractions)


def test_cache_that_cannot_be_written_gives_a_readable_error(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    _model(monkeypatch, site, known=True)
    (tmp_path / "models").write_text("a file, not a folder")
    with pytest.raises(DiskError, match="Could not remove .* choose another cache folder"):
        fetch("large", cache=tmp_path)


def test_file_from_an_offline_folder_is_checked_against_its_record_and_copied_with_it(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    _model(monkeypatch, site, known=False)
    theirs = fetch("large", cache=tmp_path / "colleague")
    site.requests.clear()
    path = fetch("large", cache=tmp_path / "mine", offline=theirs.parent, network=False)
    assert path.read_bytes() == CONTENT and record_path(path).is_file() and not site.requests
    path.unlink()
    theirs.write_bytes(CONTENT[::-1])
    with pytest.raises(ModelFileError, match="is damaged .* Copy it again"):
        fetch("large", cache=tmp_path / "mine", offline=theirs.parent, network=False)
    record_path(theirs).unlink()
    with pytest.raises(ModelFileError, match="trusted on first use"):  # the record in the own cache still applies
        fetch("large", cache=tmp_path / "mine", offline=theirs.parent, network=False)
    assert not path.exists()
    with pytest.raises(ModelFileError, match="contains neither large.onnx nor the package"):
        fetch("large", cache=tmp_path / "mine", offline=tmp_path, network=False)
    assert not site.requests


def test_original_name_is_accepted_in_an_offline_folder_unless_two_models_share_it(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    _model(monkeypatch, site, known=True, path="rev/weights_v1.onnx")
    (tmp_path / "weights_v1.onnx").write_bytes(CONTENT)
    assert fetch("large", cache=tmp_path, offline=tmp_path, network=False).read_bytes() == CONTENT
    _model(monkeypatch, site, known=True, path="rev/model.onnx")  # both Grounding DINO files have this name
    (tmp_path / "model.onnx").write_bytes(CONTENT)
    with pytest.raises(ModelFileError, match="contains neither large.onnx"):
        fetch("large", cache=tmp_path / "other", offline=tmp_path, network=False)
