"""Places of shared stores: a folder, and a bucket of moto's server, which stands in for S3."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from uuid import uuid4

import httpx
import pytest

_RUNS = re.compile(r"Running on (http://127\.0\.0\.1:\d+)")
# Seconds in which the server has to begin.
_LONG = 60.0


@pytest.fixture(scope="session")
def s3(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The URL of a server that speaks S3, on this machine alone."""
    log = tmp_path_factory.mktemp("s3") / "log"
    command = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", "0"]
    with log.open("w") as told, subprocess.Popen(command, stdout=told, stderr=told) as server:
        try:
            yield _address(log)
        finally:
            server.kill()


@pytest.fixture
def bucket(s3: str, monkeypatch: pytest.MonkeyPatch) -> str:
    """A new bucket and a prefix in it, as an option names them."""
    for name, value in credentials(s3).items():
        monkeypatch.setenv(name, value)
    name = f"skin-{uuid4().hex[:12]}"
    httpx.put(f"{s3}/{name}").raise_for_status()
    return f"s3://{name}/heads/film"


# With a bucket they are slow: each asks it some fifty times. Tests of `bucket` meet its answers.
@pytest.fixture(params=["folder", pytest.param("bucket", marks=pytest.mark.slow)])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """A new place of each kind, as an option names it."""
    if request.param == "bucket":
        found: str = request.getfixturevalue("bucket")
        return found
    return str(new_folder(tmp_path))


def new_folder(parent: Path) -> Path:
    folder = parent / "shared"
    folder.mkdir(parents=True)
    return folder


def credentials(url: str) -> dict[str, str]:
    """What programs of S3 read from the environment."""
    keys = {"AWS_ACCESS_KEY_ID": "testing", "AWS_SECRET_ACCESS_KEY": "testing"}
    nowhere = {"AWS_CONFIG_FILE": "/dev/null", "AWS_SHARED_CREDENTIALS_FILE": "/dev/null"}
    return {**keys, **nowhere, "AWS_ENDPOINT_URL": url, "AWS_DEFAULT_REGION": "us-east-1"}


def _address(log: Path) -> str:
    until = time.monotonic() + _LONG
    while time.monotonic() < until:
        if found := _RUNS.search(log.read_text()):
            return found[1]
        time.sleep(0.05)
    raise AssertionError(f"moto's server did not begin: {log.read_text()}")
