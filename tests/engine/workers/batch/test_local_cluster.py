"""The cluster that a batch starts on this computer is nobody else's."""

from __future__ import annotations

import contextlib
import os
import socket
import ssl
from collections.abc import Iterator
from pathlib import Path

import pytest
from distributed import Client

from engine.workers.batch.cluster import connected_client, worker_resources
from engine.workers.batch.settings import BatchSettings
from tests.conftest import PATIENCE


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    settings = BatchSettings(out=tmp_path_factory.mktemp("out"), workers=1)
    with connected_client(settings) as client:
        client.wait_for_workers(1, timeout=PATIENCE)
        yield client


def test_scheduler_and_worker_speak_tls_and_refuse_whoever_has_no_key(client: Client) -> None:
    address = client.scheduler.address
    assert address.startswith("tls://127.0.0.1:")
    assert all(worker.startswith("tls://") for worker in worker_resources(client))
    host, _, port = address.removeprefix("tls://").rpartition(":")
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    with (
        pytest.raises((ssl.SSLError, OSError)),
        socket.create_connection((host, int(port)), PATIENCE) as plain,
        context.wrap_socket(plain) as stranger,
    ):
        if not stranger.recv(1):
            raise ConnectionResetError


def test_tasks_run_there(client: Client) -> None:
    assert client.submit(os.getpid, pure=False).result(timeout=PATIENCE) != os.getpid()


def listening(pids: set[int]) -> set[int]:
    """Return the TCP ports on which these processes listen (Linux)."""
    inodes = set()
    for pid in pids:
        for handle in Path(f"/proc/{pid}/fd").iterdir():
            target = ""
            with contextlib.suppress(FileNotFoundError):
                target = os.readlink(handle)
            if target.startswith("socket:["):
                inodes.add(target[8:-1])
    ports = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        if Path(table).exists():
            for line in Path(table).read_text().splitlines()[1:]:
                fields = line.split()
                if fields[3] == "0A" and fields[9] in inodes:
                    ports.add(int(fields[1].rpartition(":")[2], 16))
    return ports


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="only Linux lists its sockets in files")
def test_nothing_answers_over_http(client: Client) -> None:
    info = client.scheduler_info(n_workers=-1)
    expected = {int(client.scheduler.address.rpartition(":")[2])}
    pids = {os.getpid()}
    for address, worker in info["workers"].items():
        expected |= {int(address.rpartition(":")[2]), int(worker["nanny"].rpartition(":")[2])}
        pids.add(client.run(os.getpid, workers=[address])[address])
    assert listening(pids) <= expected
