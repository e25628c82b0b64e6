"""The workers of a batch: started on this computer, or workers of a scheduler that runs already."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator

import dask
from distributed import Client, Nanny, Scheduler, SpecCluster, Worker
from distributed.security import Security

from ...core.errors import EnvironmentProblem
from ...core.system import CORES_VARIABLE, describe_machine, usable_cores
from .settings import BatchSettings

MEMORY, GPU = "MEMORY", "GPU"
"""Resources of a worker: bytes of memory for its engines, and number of GPUs."""
_BYTES_PER_WORKER = 4_000_000_000
"""Memory of a worker on this computer, unless the number of workers is given."""
_ONE_WORKER_BYTES = 8_000_000_000
"""Reserved where the system does not say how much memory is free."""

_QUIET = {
    "distributed.admin.tick.interval": "500ms",
    "distributed.admin.system-monitor.interval": "30s",
    "distributed.worker.profile.enabled": False,
    # No modules that answer over HTTP.
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}
"""Less of what Dask watches of itself, many times a second, which would take more than scheduling does."""


@contextlib.contextmanager
def connected_client(settings: BatchSettings) -> Iterator[Client]:
    """Yield a client of the scheduler at the given address, or of a scheduler with workers on this computer.

    Raises
    ------
    EnvironmentProblem
        When the scheduler does not answer.
    """
    # Dask logs what it repairs; the summary says what was repaired here.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    with contextlib.ExitStack() as stack:
        address, security = settings.scheduler, None
        if not address:
            dask.config.set(_QUIET)
            security = _own_security()
            address = stack.enter_context(_local_cluster(settings, security)).scheduler_address
        try:
            client = Client(
                address, timeout=settings.scheduler_wait if settings.scheduler else 60, set_as_default=False,
                security=security,
            )  # fmt: skip
        except (OSError, TimeoutError, ValueError) as error:
            raise EnvironmentProblem(
                f"The scheduler at {address} does not answer ({type(error).__name__}). Check its address, and whether "
                "it runs with the same version of distributed."
            ) from error
        yield stack.enter_context(client)


class _WithoutHttp:
    """A part of a cluster that answers no browser.

    Dask starts a server for its state and its dashboard even with ``dashboard=False``, and anybody on this computer
    reaches it.
    """

    def start_http_server(self, *args: object, **kwargs: object) -> None:
        """Start nothing."""


class LocalScheduler(_WithoutHttp, Scheduler):  # type: ignore[misc]
    """The scheduler of a cluster on this computer."""


class LocalWorker(_WithoutHttp, Worker):  # type: ignore[misc]
    """A worker of a cluster on this computer."""


def _own_security() -> Security:
    """Return a key and a certificate that only this batch has: whoever reaches a scheduler can run code as its owner.

    Raises
    ------
    EnvironmentProblem
        When the package for it is missing.
    """
    try:
        return Security.temporary()
    except ImportError as error:
        raise EnvironmentProblem(
            "The package cryptography is missing, without which other users of this computer could run programs. "
            "Install requirements/batch.txt with pip."
        ) from error


def _local_cluster(settings: BatchSettings, security: Security) -> SpecCluster:
    machine = describe_machine()
    cores = list(usable_cores())
    free = machine.free_bytes or _ONE_WORKER_BYTES
    n = settings.workers or max(1, min(len(cores), free // _BYTES_PER_WORKER))
    threads = settings.threads or max(1, len(cores) // n)
    workers = {}
    for number in range(n):
        # One after the other, and again from the first where there are fewer cores than asked for.
        own = sorted({cores[(number * threads + i) % len(cores)] for i in range(threads)})
        workers[number] = {
            "cls": Nanny,
            "options": {
                "nthreads": 1,
                "host": "127.0.0.1",
                "protocol": "tls://",
                "security": security,
                "worker_class": LocalWorker,
                # The engine is another process: this is no limit for it.
                "memory_limit": 0,
                "resources": {MEMORY: free // n, GPU: 1 if number == 0 and settings.gpu_stages else 0},
                "env": {CORES_VARIABLE: ",".join(map(str, own))},
                "silence_logs": logging.CRITICAL,
            },
        }
    options = {"host": "127.0.0.1", "port": 0, "protocol": "tls://", "security": security, "dashboard": False}
    scheduler = {"cls": LocalScheduler, "options": options}
    return SpecCluster(workers=workers, scheduler=scheduler, security=security, silence_logs=logging.CRITICAL)


def worker_resources(client: Client) -> dict[str, dict[str, float]]:
    """Return the resources of each worker that is connected now, by its address."""
    workers = client.scheduler_info(n_workers=-1)["workers"]
    return {address: dict(worker.get("resources") or {}) for address, worker in workers.items()}
