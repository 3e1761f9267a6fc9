"""The memory of the machine, and the shares of it that are used by default."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rhytid.device.select import Candidate

# Of the memory of a device that has its own.
DEVICE_SHARE = 0.8
# Of the memory of the machine: what a CPU computes with, stored frames, and what requests and jobs
# hold, those that decode uploads too. What small requests hold beside these is a part of the last:
# `rhytid.api.request_memory`. The rest is for Python, compilers and everything else that runs.
CPU_SHARE, FRAME_SHARE, HOST_SHARE = 0.5, 0.1, 0.2
# The least for requests and jobs.
LEAST_HOST = 512 << 20
# If the system does not report it.
_FALLBACK = 8 << 30
# Files that limit the memory of a container, of either version of control groups.
_LIMITS = (
    Path("/sys/fs/cgroup/memory.max"),
    Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"),
)


def machine_memory() -> int:
    """Bytes of memory of the machine, or of the container that this process runs in."""
    try:
        total = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        total = _FALLBACK
    limits = [limit for limit in map(_limit, _LIMITS) if limit is not None]
    return min([total if total >= 1 << 20 else _FALLBACK, *limits])


def usual_device_memory(device: Candidate) -> int:
    """Bytes that are taken of a device where no setting says how many: a share of its own memory,
    or of the machine's where it is a CPU."""
    if device.kind == "cpu":
        return int(CPU_SHARE * min(device.memory, machine_memory()))
    return int(DEVICE_SHARE * device.memory)


def usual_frame_memory() -> int:
    """Bytes for stored frames where no setting says how many."""
    return int(FRAME_SHARE * machine_memory())


def usual_host_memory() -> int:
    """Bytes for answers and uploads where no setting says how many."""
    return max(int(HOST_SHARE * machine_memory()), LEAST_HOST)


def _limit(file: Path) -> int | None:
    try:
        text = file.read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError):
        return None
    return int(text) if text.isdigit() and int(text) > 0 else None
