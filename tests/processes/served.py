"""`rhytid serve` as a process, with a driver that can be told to fail."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest

from api.asking import NPY, built, npy
from api.patch import smile, upload

TILE = "tiles/1001/0/0/0"
SOURCE = Path(__file__).with_name("faults.c")
# Seconds that a server may take for anything at all, on a machine that is busy.
LONG = 120.0
LISTENS = re.compile(r"^rhytid \S+ on (http://[^,\s]+),", re.MULTILINE)


@pytest.fixture(scope="session")
def faults(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The library of faults, compiled."""
    library = tmp_path_factory.mktemp("faults") / "faults.so"
    command = ["cc", "-shared", "-fPIC", "-O1", "-o", str(library), str(SOURCE), "-ldl"]
    subprocess.run(command, check=True)
    return library


@dataclass
class Served:
    """A running server.  fault: the file that tells its driver to fail."""

    process: subprocess.Popen[bytes]
    client: httpx.Client
    fault: Path
    asset: str = ""

    @property
    def child(self) -> int:
        """The process of the device, which is waited for."""
        return await_value(lambda: next(iter(children(self.process.pid)), None))

    @property
    def frame(self) -> str:
        return f"/v1/assets/{self.asset}/frames/smile"

    def make(self) -> None:
        """Build an asset, and send a frame."""
        self.asset = built(self.client, upload())
        self.client.put(self.frame, content=npy(smile()), headers=NPY).raise_for_status()

    def tile(self, at: str = TILE, **query: str) -> httpx.Response:
        return self.client.get(f"{self.frame}/{at}", params=query)

    def ready(self) -> bool:
        return self.client.get("/readyz").status_code == 200

    def restarts(self) -> dict[str, int]:
        """By cause, those that there were."""
        lines = self.client.get("/metrics").text.splitlines()
        name = "rhytid_device_restarts_total{"
        found = [line.removeprefix(name) for line in lines if line.startswith(name)]
        pairs = [line.split("} ") for line in found]
        return {cause.split('"')[1]: int(float(n)) for cause, n in pairs if float(n)}

    def await_kills(self, count: int) -> None:
        """Until the process was killed so often, and the device computes again."""
        await_value(lambda: self.restarts() == {"killed": count} and self.ready())

    def fail(self, word: str) -> None:
        self.fault.write_text(word)

    def heal(self) -> None:
        self.fault.unlink(missing_ok=True)


@contextmanager
def serving(
    folder: Path,
    faults: Path,
    *options: str,
    seconds: int = 600,
    run: tuple[str, ...] = ("-m", "rhytid"),
) -> Iterator[Served]:
    """A server on the store in `folder`.  seconds: that a call of the driver may take.  run: what
    Python runs."""
    fault = folder / "fault"
    preload = {"LD_PRELOAD": str(faults), "RHYTID_TEST_FAULT": str(fault)}
    environment = {**os.environ, **preload, "RHYTID_LAUNCH_SECONDS": str(seconds)}
    command = [sys.executable, *run, "serve", "--port", "0"]
    command += ["--store", str(folder / "store"), *options]
    log = folder / f"log{len(list(folder.glob('log*')))}"
    with (  # not a pipe, which fills up where nobody reads it
        log.open("w") as told,
        subprocess.Popen(command, env=environment, stdout=told, stderr=told) as process,
    ):
        try:
            url = await_value(lambda: LISTENS.search(log.read_text()))[1]
            with closing(httpx.Client(base_url=url, timeout=LONG)) as client:
                yield Served(process, client, fault)
        finally:
            process.kill()


def await_value(look: Any) -> Any:
    """What `look` finds, once it finds something."""
    until = time.monotonic() + LONG
    while time.monotonic() < until:
        found = look()
        if found:
            return found
        time.sleep(0.05)
    raise AssertionError("it never came")


def children(pid: int) -> list[int]:
    """The processes that a process has started and that are still there."""
    found = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(child) for file in found for child in file.read_text().split() if alive(int(child))]


def alive(pid: int) -> bool:
    """Whether a process is there, and no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False
