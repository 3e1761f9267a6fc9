"""Choosing an OpenCL device: a driver may list a device that does not compute."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import rhytid_kernels
from rhytid.device import trial
from rhytid.device.remembered import recall, remember
from rhytid.device.sigint import without_sigint
from rhytid.device.trial import cl
from rhytid.errors import NoDeviceError

ADVICE = (
    "Get a CPU runtime with  pip install intel-opencl-rt intel-cmplr-lib-rt  (x86-64), or PoCL "
    "with  apt-get install pocl-opencl-icd  (Debian, Ubuntu), or install your GPU vendor's driver."
)
_FILE = "devices.json"
# How much slower than the fastest a CPU driver may be that comes first in the usual order. Those
# worth having differ by less, and noise must not make the choice another one at every start.
_SLOWER = 3.0


@dataclass(frozen=True)
class Candidate:
    """A device that a driver lists. `kind` is cpu, gpu or other; `memory`, the `largest_buffer` and
    the `local_memory` of a work-group in bytes, `largest_group` in work-items."""

    index: int
    name: str
    platform: str
    kind: str
    version: str
    compute_units: int
    memory: int
    largest_buffer: int
    local_memory: int
    largest_group: int
    handle: Any

    @property
    def identity(self) -> str:
        """Identifies the device while the machine and its drivers stay the same."""
        return f"{self.platform} | {self.name} | {self.version}"

    def matches(self, wanted: str) -> bool:
        """Whether `wanted` is this index or part of the name, the platform or the version."""
        if wanted.isdigit():
            return int(wanted) == self.index
        return wanted.lower() in f"{self.name} {self.platform} {self.version}".lower()


@lru_cache(maxsize=1)
@without_sigint()
def candidates() -> tuple[Candidate, ...]:
    """Every OpenCL device of this process, in the order of its drivers."""
    try:
        platforms = cl.get_platforms()
    except cl.Error:
        return ()
    handles = [(p, d) for p in platforms for d in _devices(p)]
    return tuple(_candidate(i, p, d) for i, (p, d) in enumerate(handles))


def computes(candidate: Candidate) -> bool:
    """Whether it compiles and runs a small kernel."""
    return trial.computes(candidate.handle)


def pace(candidate: Candidate) -> float:
    """Seconds of a small piece of drawing; infinity where it fails."""
    return trial.pace(candidate.handle)


def choose(wanted: str | None = None, cache: Path | None = None) -> Candidate:
    """The first device that computes, of those that `wanted` names or of all: GPUs first, then
    CPUs, then the rest; of equals in the order of the drivers.

    Of several CPU devices, those other than PoCL's come first, but not one that takes three times
    as long as another for a small piece of drawing.  cache: a folder that remembers which it was.

    Raises NoDeviceError; never falls back to a device that was not asked for.
    """
    found = candidates()
    if not found:
        raise NoDeviceError(f"no OpenCL device found. {ADVICE}")
    fitting = [c for c in found if wanted is None or c.matches(wanted)]
    if not fitting:
        names = "; ".join(f"{c.index}: {c.name} ({c.platform})" for c in found)
        raise NoDeviceError(f"no OpenCL device matches {wanted!r}. There is {names}")
    for kind in ("gpu", "cpu", "other"):
        for candidate in _in_order([c for c in fitting if c.kind == kind], cache):
            if computes(candidate):
                return candidate
    names = ", ".join(c.name for c in fitting)
    raise NoDeviceError(f"{names}: listed, but fails to build or run a small kernel. {ADVICE}")


def _in_order(alike: Sequence[Candidate], cache: Path | None) -> list[Candidate]:
    """Devices of one kind, the best first."""
    # Of two drivers for the same CPU, PoCL has been the slower one on every kernel.
    usual = sorted(alike, key=lambda c: (c.platform == "Portable Computing Language", c.index))
    if len(usual) < 2 or usual[0].kind != "cpu":
        return usual
    best = _quick(usual, cache)
    return [best, *(c for c in usual if c is not best)]


def _quick(usual: Sequence[Candidate], cache: Path | None) -> Candidate:
    """The first that is not much slower than another, as remembered or measured now."""
    file = None if cache is None else cache / _FILE
    by_identity = {c.identity: c for c in reversed(usual)}
    key = " + ".join([rhytid_kernels.digest(trial.PROGRAM), *sorted(by_identity)])
    known = None if file is None else recall(file).get(key)
    if isinstance(known, str) and known in by_identity:
        return by_identity[known]
    seconds = [pace(c) for c in usual]
    least = min(seconds)
    if math.isinf(least):
        return usual[0]
    best = next(c for c, s in zip(usual, seconds, strict=True) if s <= _SLOWER * least)
    if file is not None:
        remember(file, key, best.identity)
    return best


def _devices(platform: Any) -> list[Any]:
    try:
        return list(platform.get_devices())
    except cl.Error:
        return []


def _candidate(index: int, platform: Any, device: Any) -> Candidate:
    kinds = {cl.device_type.CPU: "cpu", cl.device_type.GPU: "gpu"}
    kind = next((name for bit, name in kinds.items() if device.type & bit), "other")
    return Candidate(
        index=index,
        name=device.name.strip(),
        platform=platform.name.strip(),
        kind=kind,
        version=device.version.strip(),
        compute_units=device.max_compute_units,
        memory=device.global_mem_size,
        largest_buffer=device.max_mem_alloc_size,
        local_memory=device.local_mem_size,
        largest_group=device.max_work_group_size,
        handle=device,
    )
