"""The border to the OpenCL driver: how it is called and made to compile."""

from __future__ import annotations

import signal
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import rhytid_kernels
from rhytid.device import watch
from rhytid.device.caches import free_programs
from rhytid.device.loader import prepare_loader
from rhytid.errors import DeviceError, DeviceMemoryError

prepare_loader()

import pyopencl  # noqa: E402

cl: Any = pyopencl

POCL = "Portable Computing Language"
# PoCL reads all that OpenCL C has, 18,000 lines, for each program, unless this says that they were
# read: three quarters of the time of most programs.
HEADER_READ = "-D_OPENCL_H_"


@contextmanager
def driver_errors() -> Iterator[None]:
    """Wraps a call of the OpenCL driver: the one place where its errors become ours,
    DeviceMemoryError and DeviceError."""
    watch.begin_call()
    try:
        with without_sigint():
            yield
    except cl.MemoryError as error:
        raise DeviceMemoryError(f"the OpenCL driver is out of memory: {error}") from error
    except cl.Error as error:
        raise DeviceError(f"the OpenCL driver failed: {error}") from error
    finally:
        watch.end_call()


@contextmanager
def without_sigint() -> Iterator[None]:
    """Keep SIGINT from the driver, from its threads, and from the programs that it starts: within
    the block SIGINT goes to other threads; where there are none, it comes after the block.

    PoCL links kernels by a linker of its own, which ctrl-C at a terminal reaches as well: PoCL then
    ends the whole process by SIGABRT. Threads and programs inherit what their thread has blocked.
    Blocks within a block do nothing: to ask the system twice takes as long as a launch.
    """
    if getattr(_keeping, "sigint", False) or not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    _keeping.sigint = True
    try:
        yield
    finally:
        _keeping.sigint = False
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


# Whether this thread keeps SIGINT from the driver now.
_keeping = threading.local()


@without_sigint()
def open_context(handle: Any) -> Any:
    """A context on one device; raises the driver's own error."""
    return cl.Context([handle])


@without_sigint()
def compile_program(context: Any, text: str, options: list[str]) -> Any:
    """Build a program; raises the driver's own error. Suppresses pyopencl's warnings about output
    of the compiler, and about a cache that fails, where it compiles without."""
    watch.begin_compiling()
    try:
        free_programs()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", cl.CompilerWarning)
            warnings.filterwarnings("ignore", "PyOpenCL compiler caching failed")
            if context.devices[0].platform.name.strip() == POCL:
                with suppress(cl.RuntimeError):  # it is wrong, or uses what is not declared there
                    declared = rhytid_kernels.builtins() + text
                    return _built(context, declared, [*options, HEADER_READ])
            return _built(context, text, options)
    finally:
        watch.end_call()


def _built(context: Any, text: str, options: list[str]) -> Any:
    return cl.Program(context, text).build(options)
