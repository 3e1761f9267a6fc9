"""What most tests of the transport ask, and how they read a refusal."""

from __future__ import annotations

import io
from typing import Any

import httpx
import numpy as np

NPY = {"Content-Type": "application/x-npy"}


def npy(array: Any) -> bytes:
    """The array as a .npy file."""
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def array_of(response: httpx.Response) -> Any:
    """The array of a .npy answer."""
    assert response.status_code == 200, response.text
    assert response.headers["content-type"] == "application/x-npy"
    return np.load(io.BytesIO(response.content))


def built(client: httpx.Client, files: Any) -> str:
    """The id of a new asset; its last event is awaited, so that an engine may take its time."""
    made = client.post("/v1/assets", files=files).raise_for_status().json()
    with client.stream("GET", f"/v1/jobs/{made['job']}/events") as events:
        assert b'"state": "done"' in events.read()
    return str(made["id"])


def is_problem(response: httpx.Response, status: int, kind: str | None = None) -> str:
    """The detail of a problem of that status and kind; no kind = one of the framework's own."""
    assert response.status_code == status, response.text
    assert response.headers["content-type"] == "application/problem+json"
    body = response.json()
    assert body.keys() == {"type", "title", "status", "detail", "request_id"}
    assert body["request_id"] == response.headers["x-request-id"]
    assert body["status"] == status
    assert body["title"]
    assert body["type"] == (f"urn:rhytid:problem:{kind}" if kind else "about:blank")
    return str(body["detail"])
