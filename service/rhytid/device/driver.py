"""The border to the OpenCL driver: how it is called and made to compile."""

from __future__ import annotations

import signal
import threading
import warnings
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from typing import Any

import rhytid_kernels
from rhytid.device import watch
from rhytid.device.caches import free_programs
from rhytid.device.loader import prepare_loader
from rhytid.errors import DeviceError, DeviceMemoryError

prepare_loader()

import pyopencl  # noqa: E402

cl: Any = pyopencl

# What compilers say, and a cache that fails, where programs are compiled without it. For good, for
# `catch_warnings` is not for several threads, which compile at once.
warnings.simplefilter("ignore", cl.CompilerWarning)
warnings.filterwarnings("ignore", "PyOpenCL compiler caching failed")

POCL = "Portable Computing Language"
# PoCL reads all that OpenCL C has, 18,000 lines, for each program, unless this says that they were
# read: three quarters of the time of most programs.
HEADER_READ = "-D_OPENCL_H_"


def driver_errors() -> AbstractContextManager[None]:
    """Wraps a call of the OpenCL driver: the one place where its errors become ours,
    DeviceMemoryError and DeviceError."""
    return _DriverCall()


class _DriverCall:
    """A class, as entering and leaving a generator takes longer than many a call does."""

    def __enter__(self) -> None:
        watch.begin_call()
        try:
            self._before = _keep_sigint()
        except BaseException:
            watch.end_call()
            raise

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        try:
            _let_sigint(self._before)
        finally:
            watch.end_call()
        if isinstance(error, cl.MemoryError):
            raise DeviceMemoryError(f"the OpenCL driver is out of memory: {error}") from error
        if isinstance(error, cl.Error):
            raise DeviceError(f"the OpenCL driver failed: {error}") from error


@contextmanager
def without_sigint() -> Iterator[None]:
    """Keep SIGINT from the driver, from its threads, and from the programs that it starts: within
    the block SIGINT goes to other threads; where there are none, it comes after the block.

    PoCL links kernels by a linker of its own, which ctrl-C at a terminal reaches as well: PoCL then
    ends the whole process by SIGABRT. Threads and programs inherit what their thread has blocked.
    Blocks within a block do nothing: to ask the system twice takes as long as a launch.
    """
    before = _keep_sigint()
    try:
        yield
    finally:
        _let_sigint(before)


# Whether this thread keeps SIGINT from the driver now.
_keeping = threading.local()


def _keep_sigint() -> set[int] | None:
    """Block SIGINT for this thread; returns what was blocked, None where this has been done."""
    if getattr(_keeping, "sigint", False) or not hasattr(signal, "pthread_sigmask"):  # Windows
        return None
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    _keeping.sigint = True
    return before


def _let_sigint(before: set[int] | None) -> None:
    """Undo `_keep_sigint`."""
    if before is not None:
        _keeping.sigint = False
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@without_sigint()
def open_context(handle: Any) -> Any:
    """A context on one device; raises the driver's own error."""
    return cl.Context([handle])


@without_sigint()
def compile_program(context: Any, text: str, options: list[str]) -> Any:
    """Build a program; raises the driver's own error."""
    watch.begin_compiling()
    try:
        free_programs()
        if context.devices[0].platform.name.strip() == POCL:
            with suppress(cl.RuntimeError):  # it is wrong, or uses what is not declared there
                declared = rhytid_kernels.builtins() + text
                return _built(context, declared, [*options, HEADER_READ])
        return _built(context, text, options)
    finally:
        watch.end_call()


def _built(context: Any, text: str, options: list[str]) -> Any:
    return cl.Program(context, text).build(options)
