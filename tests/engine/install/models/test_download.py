"""Weight files from a URL: resumed downloads, proxies, offline folders, and trust on first use."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest

from engine.core.errors import Cancelled, DiskError, EnvironmentProblem, FormatError, ModelFileError
from engine.core.events import Event, Progress
from engine.install.models import download as download_module
from engine.install.models.cache import locate
from engine.install.models.fetching import fetch
from engine.install.models.onnx_session import open_session
from engine.install.models.verification import record_path
from tests.engine.install.models.site import CONTENT, Site, add_model, onnx_file, running_proxy

OTHER = onnx_file(len(CONTENT), filler=1)


def _files(cache: Path) -> set[str]:
    return {path.name for path in (cache / "models").iterdir()}


@pytest.mark.parametrize("known", [True, False], ids=["hash-in-the-table", "trusted-on-first-use"])
def test_interrupted_download_is_resumed_where_it_stopped(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch, known: bool
) -> None:
    add_model(monkeypatch, site, known=known)
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
    add_model(monkeypatch, site, known=False)
    site.breaks_after = 300_000
    with pytest.raises(EnvironmentProblem):
        fetch("large", cache=tmp_path)
    site.breaks_after, site.content, site.etag = None, OTHER, '"two"'
    assert fetch("large", cache=tmp_path).read_bytes() == OTHER


def test_download_from_a_server_without_ranges_or_etags_starts_again(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_model(monkeypatch, site, known=False)
    site.breaks_after, site.etag, site.ranges = 300_000, None, False
    with pytest.raises(EnvironmentProblem):
        fetch("large", cache=tmp_path)
    site.breaks_after = None
    assert fetch("large", cache=tmp_path).read_bytes() == CONTENT
    assert [wanted for _, wanted in site.requests] == [None, None]


def test_partial_file_longer_than_the_file_is_discarded(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_model(monkeypatch, site, known=True)
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "large.onnx.part").write_bytes(CONTENT + b"more")
    assert fetch("large", cache=tmp_path).read_bytes() == CONTENT


def test_file_that_differs_from_the_catalogue_leaves_nothing_in_the_cache(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_model(monkeypatch, site, known=True)
    site.content = OTHER
    with pytest.raises(ModelFileError, match="is not the file listed in the catalogue"):
        fetch("large", cache=tmp_path)
    assert _files(tmp_path) == set()


def test_hash_of_the_first_use_is_recorded_and_enforced(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = add_model(monkeypatch, site, known=False)
    assert model.pin == "pinned by revision; hash is written on first fetch and checked afterwards"
    path = fetch("large", cache=tmp_path)
    record = json.loads(record_path(path).read_text(encoding="utf-8"))
    assert record == {"size": len(CONTENT), "sha256": hashlib.sha256(CONTENT).hexdigest(), "source": model.source}
    path.write_bytes(CONTENT[:-1] + b"x")
    with pytest.raises(ModelFileError, match="is damaged .*first use"):
        locate("large", tmp_path)
    assert fetch("large", cache=tmp_path).read_bytes() == CONTENT
    site.content = OTHER
    path.write_bytes(CONTENT[:-1] + b"x")
    with pytest.raises(ModelFileError, match="is not the file that was trusted on first use .* delete .*large.onnx"):
        fetch("large", cache=tmp_path)
    record_path(path).write_text("{")
    with pytest.raises(FormatError, match="cannot be read: .*Delete it together with large.onnx, then fetch"):
        locate("large", tmp_path)


@pytest.mark.parametrize("record_too", [True, False], ids=["with-its-record", "alone"])
def test_file_that_the_user_deletes_is_fetched_anew(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch, record_too: bool
) -> None:
    """Every message about a wrong file says to delete it; the right one must be accepted then."""
    add_model(monkeypatch, site, known=False)
    site.content = OTHER  # complete, but no model: ONNX Runtime refuses it
    path = fetch("large", cache=tmp_path)
    with pytest.raises(ModelFileError, match="Delete it and run: python -m engine models fetch large"):
        open_session(path)
    path.unlink()
    if record_too:
        record_path(path).unlink()
    site.content = CONTENT
    assert fetch("large", cache=tmp_path).read_bytes() == CONTENT
    assert locate("large", tmp_path) == path


def test_file_copied_into_the_cache_by_hand_is_neither_trusted_nor_deleted(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_model(monkeypatch, site, known=False)
    path = tmp_path / "models" / "large.onnx"
    path.parent.mkdir()
    path.write_bytes(CONTENT)
    with pytest.raises(ModelFileError, match="copied here by hand"):
        locate("large", tmp_path)
    with pytest.raises(ModelFileError, match="fetch large --from FOLDER"):
        fetch("large", cache=tmp_path)
    assert path.read_bytes() == CONTENT and not site.requests


def test_proxy_of_the_environment_is_used(tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    add_model(monkeypatch, site, known=True, host="models.invalid")
    with running_proxy(site.port) as proxy:
        monkeypatch.setenv("https_proxy", f"http://127.0.0.1:{proxy.port}")
        assert fetch("large", cache=tmp_path).read_bytes() == CONTENT
    assert proxy.asked_for == ["models.invalid:443"]


def test_errors_of_network_and_url_say_what_to_do(tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    add_model(monkeypatch, site, known=True, host="127.0.0.1:9")
    with pytest.raises(EnvironmentProblem, match="Could not download large .* set HTTPS_PROXY; .* --from FOLDER"):
        fetch("large", cache=tmp_path)
    add_model(monkeypatch, site, known=True, path="gone/large.onnx")
    with pytest.raises(ModelFileError, match="no longer at http.*Get large.onnx from a colleague"):
        fetch("large", cache=tmp_path)


def test_cancel_keeps_the_partial_download_and_progress_is_reported(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_model(monkeypatch, site, known=True)
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
    add_model(monkeypatch, site, known=True)
    (tmp_path / "models").write_text("a file, not a folder")
    with pytest.raises(DiskError, match="Could not write .* choose another folder"):
        fetch("large", cache=tmp_path)


def test_file_from_an_offline_folder_is_checked_against_its_record_and_copied_with_it(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_model(monkeypatch, site, known=False)
    theirs = fetch("large", cache=tmp_path / "colleague")
    site.requests.clear()
    path = fetch("large", cache=tmp_path / "mine", offline=theirs.parent, network=False)
    assert path.read_bytes() == CONTENT and record_path(path).is_file() and not site.requests
    path.write_bytes(b"damaged")
    theirs.write_bytes(OTHER)
    with pytest.raises(ModelFileError, match="is damaged .* Copy it there again, and delete large.onnx.trusted.json"):
        fetch("large", cache=tmp_path / "mine", offline=theirs.parent, network=False)
    record_path(theirs).unlink()
    with pytest.raises(ModelFileError, match="trusted on first use"):  # the record in the own cache still applies
        fetch("large", cache=tmp_path / "mine", offline=theirs.parent, network=False)
    path.unlink()
    fetch("large", cache=tmp_path / "mine", offline=theirs.parent, network=False)
    assert path.read_bytes() == OTHER
    path.unlink()
    with pytest.raises(ModelFileError, match="contains neither large.onnx nor the package"):
        fetch("large", cache=tmp_path / "mine", offline=tmp_path, network=False)
    assert not site.requests


def test_original_name_is_accepted_in_an_offline_folder_unless_two_models_share_it(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_model(monkeypatch, site, known=True, path="rev/weights_v1.onnx")
    (tmp_path / "weights_v1.onnx").write_bytes(CONTENT)
    assert fetch("large", cache=tmp_path, offline=tmp_path, network=False).read_bytes() == CONTENT
    add_model(monkeypatch, site, known=True, path="rev/model.onnx")  # both Grounding DINO files have this name
    (tmp_path / "model.onnx").write_bytes(CONTENT)
    with pytest.raises(ModelFileError, match="contains neither large.onnx"):
        fetch("large", cache=tmp_path / "other", offline=tmp_path, network=False)
