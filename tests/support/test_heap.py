"""Freed memory goes back to the system."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

# Blocks that malloc takes from its heap, each beside one that stays.
PROGRAM = """
import ctypes, os
from rhytid.support.heap import give_back_heap

def held():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")

blocks = [b"x" * 100_000 for _ in range(2000)]
kept = blocks[::20]
del blocks
before = held()
give_back_heap()
print(before - held())
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="glibc alone has a call for it")
def test_freed_memory_goes_back_to_the_system() -> None:
    said = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True
    ).stdout
    assert int(said) > 100_000_000
