"""`rhytid serve` as a process to be attacked, and what it holds of memory and processor time."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import httpx

from processes.served import LISTENS, LONG, await_value

__all__ = ["Attacked", "Peak", "await_value", "resident", "serving"]

_TICK = os.sysconf("SC_CLK_TCK")


@dataclass
class Attacked:
    """A running server."""

    process: subprocess.Popen[bytes]
    client: httpx.Client
    log: Path
    address: tuple[str, int] = field(init=False)

    def __post_init__(self) -> None:
        url = self.client.base_url
        self.address = (url.host, url.port or 80)

    def tree(self) -> list[int]:
        """The server and the processes that it has started."""
        return with_children(self.process.pid)

    def resident(self) -> int:
        """Bytes of memory that all of them hold, what they share counted once."""
        return sum(resident(pid) for pid in self.tree())

    def processor(self) -> float:
        """Seconds of processor time, of ended children too."""
        return sum(processor(pid) for pid in self.tree())


@contextmanager
def serving(folder: Path, *options: str, **settings: str) -> Iterator[Attacked]:
    """A server on the store in `folder`, with environment variables."""
    command = [sys.executable, "-m", "rhytid", "serve", "--port", "0"]
    command += ["--store", str(folder / "store"), *options]
    log = folder / f"log{len(list(folder.glob('log*')))}"
    environment = {**os.environ, **settings}
    with (
        log.open("w") as told,
        subprocess.Popen(command, env=environment, stdout=told, stderr=told) as process,
    ):
        try:
            url = await_value(lambda: LISTENS.search(log.read_text()))[1]
            with closing(httpx.Client(base_url=url, timeout=LONG)) as client:
                await_value(lambda: client.get("/readyz").status_code == 200)
                yield Attacked(process, client, log)
        finally:
            process.terminate()
            try:
                process.wait(30)
            except subprocess.TimeoutExpired:
                process.kill()


def with_children(pid: int) -> list[int]:
    """A process and all that descend from it."""
    found = [pid]
    for parent in found:
        for file in Path(f"/proc/{parent}/task").glob("*/children"):
            with suppress(OSError):
                found += [int(child) for child in file.read_text().split()]
    return found


def resident(pid: int) -> int:
    """Bytes of a process in memory that no file on disk holds; of what is shared its part (0 where
    it is gone). Libraries are left out: their part changes with who else uses them."""
    try:
        text = Path(f"/proc/{pid}/smaps_rollup").read_text()
    except OSError:
        return 0
    found = re.findall(r"^Pss_(?:Anon|Shmem): +([0-9]+) kB", text, re.MULTILINE)
    return 1024 * sum(map(int, found))


def processor(pid: int) -> float:
    """Seconds of processor time of a process and its ended children (0 where it is gone)."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    except OSError:
        return 0.0
    return sum(map(int, fields[11:15])) / _TICK


class Peak:
    """The most memory that a server holds within a block, and what it took of the processor."""

    def __init__(self, server: Attacked) -> None:
        self._server, self._end = server, threading.Event()
        self.before = self.most = self.after = 0
        self.seconds = 0.0

    def __enter__(self) -> Peak:
        self.before = self.most = self._server.resident()
        self.seconds = -self._server.processor()
        self._thread = threading.Thread(target=self._watch)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()
        self.after = self._server.resident()
        self.seconds += self._server.processor()

    @property
    def more(self) -> int:
        """Bytes above what it held before."""
        return self.most - self.before

    def _watch(self) -> None:
        while not self._end.wait(0.02):
            self.most = max(self.most, self._server.resident())
