"""Choosing an OpenCL device. A driver may list a device that does not compute, so each one is
tried; measurements are remembered in a JSON file."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

import rhytid_kernels
from rhytid.device import driver, watch
from rhytid.device.driver import cl, without_sigint
from rhytid.errors import NoDeviceError

ADVICE = (
    "Get a CPU runtime with  pip install intel-opencl-rt intel-cmplr-lib-rt  (x86-64), or PoCL "
    "with  apt-get install pocl-opencl-icd  (Debian, Ubuntu), or install your GPU vendor's driver."
)
_FILE = "devices.json"
# How much slower than the fastest a CPU driver may be that comes first in the usual order. Those
# worth having differ by less, and noise must not make the choice another one at every start.
_SLOWER = 3.0
PROGRAM = "trial"
_ITEMS = 256
# Work-groups of the timed kernel, and the floats that each writes: about 0.1 ms on two good cores.
_GROUPS, _GROUP_FLOATS = 128, 16 * 8
_ROUNDS = 4


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
    """Whether a device compiles and runs a small kernel: a driver can list one and fail at the
    first build."""
    try:
        return bool(np.array_equal(_probed(candidate.handle), 2.0 * np.arange(_ITEMS)))
    except (cl.Error, RuntimeError):
        return False


def pace(candidate: Candidate) -> float:
    """Seconds that a device takes for a small piece of drawing, the least of a few; infinity where
    it fails."""
    try:
        return _paced(candidate.handle)
    except (cl.Error, RuntimeError):
        return math.inf


def choose(wanted: str | None = None, cache: Path | None = None) -> Candidate:
    """The first device that computes, of those that `wanted` names, or of all: GPUs first, then
    CPUs, then the rest; of the same kind in the order of the drivers.

    Of several CPU devices, PoCL's come last; but the first is none that takes more than three times
    as long as another for a small piece of drawing.  cache: the folder that remembers the choice.

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
    usual = sorted(alike, key=lambda c: (c.platform == driver.POCL, c.index))
    if len(usual) < 2 or usual[0].kind != "cpu":
        return usual
    best = _quick(usual, cache)
    return [best, *(c for c in usual if c is not best)]


def _quick(usual: Sequence[Candidate], cache: Path | None) -> Candidate:
    """The first device that is not much slower than another, as remembered or measured now."""
    file = None if cache is None else cache / _FILE
    by_identity = {c.identity: c for c in reversed(usual)}
    key = " + ".join([rhytid_kernels.digest(PROGRAM), *sorted(by_identity)])
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


class _Trial:
    """The trial program on a device, with a buffer of `floats` floats. Holds its context: rusticl
    frees one that only a program still needs."""

    def __init__(self, handle: Any, floats: int) -> None:
        self._context = driver.open_context(handle)
        self.program = driver.compile_program(self._context, rhytid_kernels.source(PROGRAM), [])
        self.queue = cl.CommandQueue(self._context)
        self.buffer = cl.Buffer(self._context, cl.mem_flags.READ_WRITE, 4 * floats)


@without_sigint()
def _probed(handle: Any) -> Any:
    trial, host = _Trial(handle, _ITEMS), np.empty(_ITEMS, np.float32)
    with watch.driver_call():
        cl.Kernel(trial.program, "probe")(trial.queue, host.shape, None, trial.buffer)
        cl.enqueue_copy(trial.queue, host, trial.buffer)
    return host


@without_sigint()
def _paced(handle: Any) -> float:
    trial, seconds = _Trial(handle, _GROUPS * _GROUP_FLOATS), []
    kernel = cl.Kernel(trial.program, "pace")
    for _ in range(1 + _ROUNDS):
        start = time.perf_counter()
        with watch.driver_call():
            kernel(trial.queue, (_GROUPS,), (1,), trial.buffer)
            trial.queue.finish()
        seconds.append(time.perf_counter() - start)
    return min(seconds[1:])  # the first compiles


def recall(file: Path) -> dict[str, Any]:
    """The remembered measurements by key; none where the file is missing or damaged."""
    with suppress(OSError, ValueError):
        found = json.loads(file.read_text(encoding="utf-8"))
        return found if isinstance(found, dict) else {}
    return {}


def remember(file: Path, key: str, value: Any) -> None:
    """Remember a measurement, unless the file cannot be written."""
    known = {**recall(file), key: value}
    with suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(known, indent=1), encoding="utf-8")
