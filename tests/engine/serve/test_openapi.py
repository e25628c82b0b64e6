"""Requests drawn from our own OpenAPI description: none breaks the server, each answer is one that it describes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from hypothesis import HealthCheck, Phase, given, settings

from engine.serve import Accounts, ServeSettings
from engine.serve.app import create_app

from .conftest import API, Client

STREAMS = f"{API}/projects/{{project_id}}/events"
"""Never ends; tests/engine/serve/test_jobs.py reads it."""
N_EXAMPLES = 8


@pytest.mark.slow
def test_drawn_requests_get_the_described_answers(
    make_client: Callable[..., Client], tmp_path: Path, page: Path
) -> None:
    import schemathesis  # with what it imports, a tenth of the start of each process of the tests

    data = tmp_path / "data"
    token = Accounts(data).add("ada")
    app = create_app(ServeSettings(data, lan=True, min_free_bytes=0, max_projects=20), ["testserver"], page)
    schema = schemathesis.openapi.from_asgi(f"{API}/openapi.json", without_lifespan(app))
    headers = {"Authorization": f"Bearer {token}"}
    operations = [found.ok() for found in schema.get_all_operations()]
    assert len(operations) > 20
    with TestClient(app, headers=headers) as http:
        for operation in operations:
            if operation.path == STREAMS:
                continue
            project = http.post(f"{API}/projects", json={"title": "Room"}).json()["id"]
            draw_requests(operation, headers, project)
            http.delete(f"{API}/projects/{project}")


def without_lifespan(app: Any) -> Any:
    """Return `app` without its start and end, which Schemathesis would ask for with each request."""

    async def call(scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] != "lifespan":
            await app(scope, receive, send)
            return
        for step in ("startup", "shutdown"):
            await receive()
            await send({"type": f"lifespan.{step}.complete"})

    return call


def draw_requests(operation: Any, headers: dict[str, str], project: str) -> None:
    """Send requests of one operation, half of them to a project that exists."""
    from schemathesis.checks import not_a_server_error
    from schemathesis.specs.openapi import checks

    found = (checks.status_code_conformance, checks.content_type_conformance, checks.response_schema_conformance)
    number = 0

    @given(case=operation.as_strategy())
    @settings(
        max_examples=N_EXAMPLES,
        deadline=None,
        derandomize=True,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    def send(case: Any) -> None:
        nonlocal number
        number += 1
        if number % 2 and "project_id" in (case.path_parameters or {}):
            case.path_parameters["project_id"] = project
        case.validate_response(case.call(headers=headers), checks=[not_a_server_error, *found])

    send()
