"""Memory of the C library in the process of the device."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path
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


@pytest.mark.parametrize(
    ("given", "wanted"),
    [
        ({}, "glibc.malloc.hugetlb=1"),
        (
            {"GLIBC_TUNABLES": "glibc.malloc.perturb=1"},
            "glibc.malloc.perturb=1:glibc.malloc.hugetlb=1",
        ),
        ({"GLIBC_TUNABLES": "glibc.malloc.hugetlb=0"}, "glibc.malloc.hugetlb=0"),
    ],
)
def test_the_process_asks_for_large_pages_unless_it_is_told(
    given: dict[str, str], wanted: str
) -> None:
    found = interpreter.environment(given)
    assert found["GLIBC_TUNABLES"] == wanted
    assert interpreter.environment(found) == found


# Prints how many KiB of 64 MiB lie in large pages.
LARGE = """
import ctypes
libc = ctypes.CDLL(None)
libc.malloc.restype = ctypes.c_void_p
at = libc.malloc(ctypes.c_size_t(64 << 20))
ctypes.memset(at, 1, 64 << 20)
lines = [line.split() for line in open("/proc/self/smaps")]
print(sum(int(line[1]) for line in lines if line[0] == "AnonHugePages:"))
"""
MODE = Path("/sys/kernel/mm/transparent_hugepage/enabled")


@pytest.mark.skipif(
    not MODE.exists() or "[madvise]" not in MODE.read_text(),
    reason="Linux gives them to all or none",
)
def test_malloc_gets_large_pages() -> None:
    assert printed(LARGE, interpreter.environment({**os.environ})) >= 32 << 10
    without = {"GLIBC_TUNABLES": "glibc.malloc.hugetlb=0"}
    assert printed(LARGE, interpreter.environment({**os.environ, **without})) < 8 << 10


@pytest.mark.parametrize("name", ["/venv/bin/rhytid", "/lib/rhytid/__main__.py"])
def test_a_command_begins_again_once(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    begun: list[Any] = []
    monkeypatch.setattr(interpreter.os, "execve", lambda *given: begun.append(given))
    monkeypatch.setattr(sys, "orig_argv", ["python", "-I", name, "bench"])
    monkeypatch.delenv("GLIBC_TUNABLES", raising=False)
    interpreter.begin_again_as_device()  # this is pytest
    assert begun == []
    monkeypatch.setattr(sys, "argv", [name, "bench"])
    interpreter.begin_again_as_device()
    ((program, command, env),) = begun
    assert command == [program, "-I", name, "bench"]
    for key, value in env.items():
        monkeypatch.setenv(key, value)
    interpreter.begin_again_as_device()
    assert len(begun) == 1
