"""Choosing an OpenCL device: one that is only listed is not yet one that computes."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from rhytid.device.loader import load_pyopencl
from rhytid.errors import NoDeviceError

cl: Any = load_pyopencl()

ADVICE = (
    "Get a CPU runtime with  pip install intel-opencl-rt intel-cmplr-lib-rt  (x86-64), or PoCL "
    "with  apt-get install pocl-opencl-icd  (Debian, Ubuntu), or install your GPU vendor's driver."
)
_PROBE = "__kernel void probe(__global float *x) { int i = get_global_id(0); x[i] = 2.0f * i; }"


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

    def matches(self, wanted: str) -> bool:
        """Whether `wanted` is this index or part of the name, the platform or the version."""
        if wanted.isdigit():
            return int(wanted) == self.index
        return wanted.lower() in f"{self.name} {self.platform} {self.version}".lower()


@lru_cache(maxsize=1)
def candidates() -> tuple[Candidate, ...]:
    """Every OpenCL device of this process, in the order of its drivers."""
    try:
        platforms = cl.get_platforms()
    except cl.Error:
        return ()
    handles = [(p, d) for p in platforms for d in _devices(p)]
    return tuple(_candidate(i, p, d) for i, (p, d) in enumerate(handles))


def computes(candidate: Candidate) -> bool:
    """Compile and run a small kernel: a driver can list a device and fail at the first build."""
    try:
        context = cl.Context([candidate.handle])
        queue = cl.CommandQueue(context)
        program = compile_program(context, _PROBE, [])
        host = np.empty(256, np.float32)
        buffer = cl.Buffer(context, cl.mem_flags.READ_WRITE, host.nbytes)
        program.probe(queue, host.shape, None, buffer)
        cl.enqueue_copy(queue, host, buffer)
    except (cl.Error, RuntimeError):
        return False
    return bool(np.array_equal(host, 2.0 * np.arange(256)))


def compile_program(context: Any, text: str, options: list[str]) -> Any:
    """Build a program; raises the runtime's own error. Drivers that chat while they compile
    would each time raise a warning, so that one is left out."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cl.CompilerWarning)
        return cl.Program(context, text).build(options)


def choose(wanted: str | None = None) -> Candidate:
    """The first device that computes, of those that `wanted` names or of all: GPUs first, then CPU
    drivers other than PoCL, then PoCL, then the rest; of equals in the order of the drivers.

    Raises NoDeviceError; never falls back to a device that was not asked for.
    """
    found = candidates()
    if not found:
        raise NoDeviceError(f"no OpenCL device found. {ADVICE}")
    fitting = [c for c in found if wanted is None or c.matches(wanted)]
    if not fitting:
        names = "; ".join(f"{c.index}: {c.name} ({c.platform})" for c in found)
        raise NoDeviceError(f"no OpenCL device matches {wanted!r}. There is {names}")
    for candidate in sorted(fitting, key=_rank):
        if computes(candidate):
            return candidate
    names = ", ".join(c.name for c in fitting)
    raise NoDeviceError(f"{names}: listed, but fails to build or run a small kernel. {ADVICE}")


def _rank(candidate: Candidate) -> tuple[int, bool, int]:
    # Of two drivers for the same CPU, PoCL has been the slower one on every kernel.
    is_pocl = candidate.platform == "Portable Computing Language"
    return {"gpu": 0, "cpu": 1}.get(candidate.kind, 2), is_pocl, candidate.index


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
