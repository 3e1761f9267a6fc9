"""A temporary server: started as a process of its own, and asked through the client SDK."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import rhytid_client
from rhytid.errors import RhytidError

# Seconds that a server may take to start and to end.
_START, _END = 180.0, 20.0
_LISTENS = re.compile(r"^rhytid \S+ on (http://[^,\s]+),", re.MULTILINE)


@contextmanager
def served(store: Path, device: str, *options: str) -> Iterator[str]:
    """Run `rhytid serve` on a free loopback port within the block; yields its URL.

    device: number of the device.  options: further ones of the command. Raises RhytidError with the
    server's output where it does not start.
    """
    command = [sys.executable, "-m", "rhytid", "serve", "--port", "0"]
    command += ["--store", str(store), "--device", device, "--without-keys", *options]
    log = store.parent / "server.log"  # not a pipe: nobody would read it
    with (
        log.open("w") as output,
        subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT) as process,
    ):
        try:
            yield _url(process, log)
        finally:
            process.terminate()
            try:
                process.wait(_END)
            except subprocess.TimeoutExpired:
                process.kill()


@contextmanager
def connected(url: str) -> Iterator[rhytid_client.Client]:
    """Yield a client of a server; its errors in the block become a RhytidError with the same
    message."""
    with closing(rhytid_client.Client(url)) as client:
        try:
            yield client
        except rhytid_client.RhytidError as error:
            raise RhytidError(str(error)) from error


def _url(process: subprocess.Popen[bytes], log: Path) -> str:
    deadline = time.monotonic() + _START
    while time.monotonic() < deadline and process.poll() is None:
        found = _LISTENS.search(log.read_text(encoding="utf-8"))
        if found:
            return found[1]
        time.sleep(0.05)
    said = log.read_text(encoding="utf-8").strip()[-500:]
    raise RhytidError(f"the server did not start: {said or 'it printed nothing'}")
