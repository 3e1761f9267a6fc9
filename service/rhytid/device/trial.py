"""Trying a device: whether it computes, and how fast it does what drawing is made of."""

from __future__ import annotations

import math
import time
import warnings
from typing import Any

import numpy as np

import rhytid_kernels
from rhytid.device import watch
from rhytid.device.caches import free_programs
from rhytid.device.loader import load_pyopencl
from rhytid.device.sigint import without_sigint

cl: Any = load_pyopencl()

PROGRAM = "trial"
_ITEMS = 256
# Work-groups of the timed kernel, and the floats that each writes: about 0.1 ms on two good cores.
_GROUPS, _GROUP_FLOATS = 128, 16 * 8
_ROUNDS = 4


def computes(handle: Any) -> bool:
    """Compile and run a small kernel: a driver can list a device and fail at the first build."""
    try:
        return bool(np.array_equal(_probed(handle), 2.0 * np.arange(_ITEMS)))
    except (cl.Error, RuntimeError):
        return False


def pace(handle: Any) -> float:
    """Seconds of a small piece of drawing, the least of a few; infinity where it fails."""
    try:
        return _paced(handle)
    except (cl.Error, RuntimeError):
        return math.inf


@without_sigint()
def open_context(handle: Any) -> Any:
    """A context on one device; raises the runtime's own error."""
    return cl.Context([handle])


@without_sigint()
def compile_program(context: Any, text: str, options: list[str]) -> Any:
    """Build a program; raises the runtime's own error. The warnings that pyopencl raises for output
    of the compiler, and where its cache fails and it compiles without, are suppressed."""
    watch.begin_compiling()
    try:
        free_programs()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", cl.CompilerWarning)
            warnings.filterwarnings("ignore", "PyOpenCL compiler caching failed")
            return cl.Program(context, text).build(options)
    finally:
        watch.end_call()


class _Trial:
    """The program on a device with room for so many floats. Holds its context: rusticl frees one
    that only a program still needs."""

    def __init__(self, handle: Any, floats: int) -> None:
        self._context = open_context(handle)
        self.program = compile_program(self._context, rhytid_kernels.source(PROGRAM), [])
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
