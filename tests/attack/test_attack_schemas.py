"""schemathesis over the OpenAPI document: every check that it has."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from attack.served import Attacked, serving

pytestmark = pytest.mark.attack
EXAMPLES = 25
SECONDS = 240
CODE = "from schemathesis.cli import schemathesis; schemathesis()"


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Attacked]:
    with serving(tmp_path, RHYTID_KEY_RATE="100000") as running:
        yield running


def test_every_answer_is_as_documented(server: Attacked, tmp_path: Path) -> None:
    url = f"{server.client.base_url}openapi.json"
    command = [sys.executable, "-c", CODE, "run", url, "--checks", "all"]
    command += ["--max-examples", str(EXAMPLES), "--seed", "14", "--max-time", str(SECONDS)]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=2 * SECONDS
    )
    print(done.stdout[-3000:])  # noqa: T201
    assert done.returncode == 0, done.stdout[-20_000:] + done.stderr[-2000:]
    assert re.search(r"[0-9]+ passed", done.stdout)
    assert server.client.get("/readyz").status_code == 200
