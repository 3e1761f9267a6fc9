"""Memory of the C library in the process of the device."""

from __future__ import annotations

import platform
import subprocess
import sys
from typing import Any

import pytest

from rhytid.processes import interpreter

pytestmark = pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="others have no settings")

# Prints how many heaps there are, apart from the first, when eight threads have allocated.
HEAPS = """
import ctypes, threading
allocate, met = ctypes.CDLL(None).malloc, threading.Barrier(9)
def work():
    allocate(100_000)
    met.wait()
    met.wait()
for _ in range(8):
    threading.Thread(target=work, daemon=True).start()
met.wait()
# Memory without a file: of all mappings one may begin at such a place by chance.
lines = [line.split() for line in open("/proc/self/maps")]
starts = [int(line[0].partition("-")[0], 16) for line in lines if len(line) == 5]
print(sum(start % (64 << 20) == 0 for start in starts))
"""


def printed(program: str, env: dict[str, str] | None = None) -> int:
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=env)
    return int(done.stdout)


def test_threads_share_few_heaps(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the environment that the process is started with."""
    given: dict[str, Any] = {}
    monkeypatch.setattr(interpreter.subprocess, "Popen", lambda *_, **named: given.update(named))
    interpreter._spawned(0)
    monkeypatch.undo()
    assert printed(HEAPS, given["env"]) <= 1
