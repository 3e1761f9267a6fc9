"""schemathesis over the OpenAPI document: every check that it has but one."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from api.asking import NPY, built, npy
from api.patch import smile, upload
from attack.served import Attacked, serving

pytestmark = pytest.mark.attack
EXAMPLES = 8
SECONDS = 150
CODE = "from schemathesis.cli import schemathesis; schemathesis()"
# A schema cannot say which bytes are a mesh: what it allows may be refused as no mesh.
EXCLUDED = "positive_data_acceptance"


@pytest.fixture
def key(tmp_path: Path) -> str:
    """A key that cannot delete the asset that all is asked of."""
    command = [sys.executable, "-m", "rhytid", "keys", "create", "all"]
    command += ["--store", str(tmp_path / "store"), "--scopes", "read", "compute"]
    command += ["--rate", "100000", "--jobs", "1000"]
    made = subprocess.run(command, capture_output=True, text=True, check=True)
    return re.findall(r"^rhytid_\S+$", made.stdout, re.MULTILINE)[0]


@pytest.fixture
def server(tmp_path: Path, key: str) -> Iterator[Attacked]:
    with serving(tmp_path) as running:
        running.client.headers["Authorization"] = f"Bearer {key}"
        yield running


def test_every_answer_is_as_documented(server: Attacked, tmp_path: Path, key: str) -> None:
    asset = built(server.client, upload())
    path = f"/v1/assets/{asset}/frames/smile"
    server.client.put(path, content=npy(smile()), headers=NPY).raise_for_status()
    known = f'[parameters]\n"path.asset" = "{asset}"\n"path.frame" = "smile"\n'
    (tmp_path / "schemathesis.toml").write_text(known)
    done = subprocess.run(
        [sys.executable, "-c", CODE, *options(server, key)],
        cwd=tmp_path,
        env={**os.environ, "SCHEMATHESIS_HOOKS": "attack.schema_hooks", "PYTHONPATH": paths()},
        capture_output=True,
        text=True,
        check=False,
        timeout=2 * SECONDS,
    )
    print(done.stdout[-1500:])  # noqa: T201
    assert done.returncode == 0, done.stdout[-20_000:] + done.stderr[-2000:]
    assert server.client.get("/readyz").status_code == 200


def options(server: Attacked, key: str) -> list[str]:
    """Of the command line."""
    url, header = f"{server.client.base_url}/openapi.json", f"Authorization: Bearer {key}"
    command = ["run", url, "--checks", "all", "--exclude-checks", EXCLUDED, "--header", header]
    command += ["--max-examples", str(EXAMPLES), "--seed", "14", "--max-time", str(SECONDS)]
    return [*command, "--generation-database", "none", "--no-color"]


def paths() -> str:
    """Where Python finds the hooks."""
    here = str(Path(__file__).parents[1])
    return os.pathsep.join([here, *filter(None, [os.environ.get("PYTHONPATH")])])
