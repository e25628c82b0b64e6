"""What the container promises and a reader of its files can check; `make container-test` builds and runs it."""

from __future__ import annotations

import re
import shlex
from fnmatch import fnmatch
from typing import Any

import pytest
import yaml

from engine.cli.main import build_parser
from engine.serve import job_queue
from tests.conftest import ROOT


def instructions() -> list[tuple[str, str]]:
    """The instructions of the Containerfile, each as a word and the rest."""
    text = re.sub(r"^#.*\n", "", (ROOT / "Containerfile").read_text(encoding="utf-8"), flags=re.MULTILINE)
    lines = text.replace("\\\n", " ").splitlines()
    return [(line.split()[0], line.split(maxsplit=1)[1]) for line in lines if line.strip()]


def of_kind(kind: str) -> list[str]:
    return [rest for word, rest in instructions() if word == kind]


@pytest.fixture
def service() -> dict[str, Any]:
    compose = yaml.safe_load((ROOT / "compose.yaml").read_text(encoding="utf-8"))
    (only,) = compose["services"].values()
    found: dict[str, Any] = only
    return found


def test_base_is_an_argument_and_used_by_every_stage() -> None:
    assert [rest.partition("=")[0] for rest in of_kind("ARG")] == ["BASE"]
    assert all(rest.startswith("${BASE}") for rest in of_kind("FROM"))


def test_everything_copied_exists_and_is_sent_to_the_build() -> None:
    sent = [line[1:] for line in (ROOT / ".containerignore").read_text().splitlines() if line.startswith("!")]
    copied = [name for rest in of_kind("COPY") if "--from" not in rest for name in rest.split()[:-1]]
    for name in copied:
        assert (ROOT / name).exists(), name
        assert name.removeprefix("./") in sent, f"{name} is left out by .containerignore"
    assert set(sent) == set(copied)


def test_packages_are_installed_with_their_hashes_only() -> None:
    for command in of_kind("RUN"):
        for part in command.split("&&"):
            if "pip install" in part:
                assert "--require-hashes" in part and "--only-binary :all:" in part and "locked-" in part


def test_no_command_runs_in_the_image_itself() -> None:
    """What a command leaves there, such as a mounted setting of the computer that builds it, would stay."""
    last = max(number for number, (word, _) in enumerate(instructions()) if word == "FROM")
    assert "RUN" not in [word for word, _ in instructions()[last:]]


def test_image_runs_without_root_and_writes_to_one_volume() -> None:
    (user,) = of_kind("USER")
    assert user.split(":")[0].isdecimal() and int(user.split(":")[0]) >= 10000
    assert of_kind("VOLUME") == ["/data"]
    environment = dict(word.split("=", 1) for word in shlex.split(of_kind("ENV")[-1]))
    written = ("HOME", "MPLCONFIGDIR", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR", "GAUSSIAN_HERITAGE_CALIBRATION")
    for name in written:
        assert environment[name].startswith(("/data", "/tmp")), name


def test_commands_are_those_of_the_engine_and_need_tokens(service: dict[str, Any]) -> None:
    in_image, check = yaml.safe_load(of_kind("CMD")[0]), yaml.safe_load(of_kind("HEALTHCHECK")[0].split("CMD")[1])
    assert yaml.safe_load(of_kind("ENTRYPOINT")[0]) == check[:3]
    for words in (in_image, service["command"]):
        options = build_parser().parse_args(words)
        # Other computers can reach the port of a container: TLS and a token for each user.
        assert options.lan and options.stop_jobs and options.first_user and str(options.data) == "/data"
    assert build_parser().parse_args(check[3:]).check
    assert service["healthcheck"]["test"] == ["CMD", *check]


def test_compose_starts_it_read_only_without_privileges(service: dict[str, Any]) -> None:
    assert service["read_only"] and service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert "privileged" not in service and "network_mode" not in service
    assert [volume.partition(":")[2] for volume in service["volumes"]] == ["/data"]
    assert any(fnmatch(mount, "/tmp:*") for mount in service["tmpfs"])
    # Only this computer reaches the port unless it is asked for.
    assert service["ports"] == ["${HERITAGE_BIND:-127.0.0.1}:8765:8765"]


def test_image_has_the_loader_of_vulkan_and_asks_for_the_driver() -> None:
    environment = dict(word.split("=", 1) for word in shlex.split(of_kind("ENV")[-1]))
    assert {"graphics", "compute", "utility"} == set(environment["NVIDIA_DRIVER_CAPABILITIES"].split(","))
    assert any("libvulkan1" in command for command in of_kind("RUN"))
    assert f"--from=build {environment['LD_LIBRARY_PATH']} {environment['LD_LIBRARY_PATH']}" in of_kind("COPY")


def test_container_starts_without_a_card_unless_it_is_asked_for(service: dict[str, Any]) -> None:
    assert "deploy" not in service and "devices" not in service
    text = (ROOT / "compose.gpu.yaml").read_text(encoding="utf-8")
    (name,) = yaml.safe_load((ROOT / "compose.yaml").read_text(encoding="utf-8"))["services"]
    (reserved,) = yaml.safe_load(text)["services"][name]["deploy"]["resources"]["reservations"]["devices"]
    assert reserved == {"driver": "nvidia", "count": "all", "capabilities": ["gpu"]}


def test_container_is_given_the_time_that_a_job_needs_to_save_its_work(service: dict[str, Any]) -> None:
    assert int(service["stop_grace_period"].removesuffix("s")) > job_queue._STOP_SECONDS + 10
