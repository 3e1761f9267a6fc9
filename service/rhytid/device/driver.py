"""The border to the OpenCL driver: how it is loaded, called and made to compile."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

from rhytid.device import watch
from rhytid.device.caches import free_programs, provide_cache_folder
from rhytid.errors import DeviceError, DeviceMemoryError
from rhytid.support.temporary_folders import removed_at_exit

SYSTEM_VENDORS = Path("/etc/OpenCL/vendors")
# A pip driver for FPGA emulation is installed with the one for CPUs; it is ignored.
_CPU_DRIVER = "intel-cpu.icd"


def _load_pyopencl() -> ModuleType:
    """Import pyopencl so that it finds pip's drivers, with a folder that drivers can write to.

    The loader inside pyopencl's wheel reads `.icd` files from one folder, the system's by default.
    A driver from pip leaves its file in the environment's own `etc/OpenCL/vendors`, often with a
    bare library name that only resolves inside `lib`. So a folder of our own gets both, with full
    paths. That is left alone where OCL_ICD_VENDORS is set, off Linux, and where pip installed no
    driver.
    """
    prefix = Path(sys.prefix)
    driver = pip_driver(prefix)
    if driver is not None and sys.platform == "linux" and "OCL_ICD_VENDORS" not in os.environ:
        os.environ["OCL_ICD_VENDORS"] = _vendor_folder(driver)
    _pin_pocl()
    provide_cache_folder()
    import pyopencl

    return pyopencl


def _pin_pocl() -> None:
    """Have PoCL keep each of its threads on a core of its own, unless the user set POCL_AFFINITY.

    Left to the system, threads that slept share a core for up to a quarter of a second: a blend
    took half as long again. PoCL numbers cores from 0, so it is left alone where this process may
    not use all of them.
    """
    if sys.platform == "linux" and os.sched_getaffinity(0) == set(range(os.cpu_count() or 0)):
        os.environ.setdefault("POCL_AFFINITY", "1")


def pip_driver(prefix: Path) -> Path | None:
    """The library of a CPU driver that pip put below `prefix`, or None."""
    entry = prefix / "etc" / "OpenCL" / "vendors" / _CPU_DRIVER
    if not entry.is_file():
        return None
    library = Path(entry.read_text(encoding="utf-8").strip())
    candidates = (library, prefix / "lib" / library.name)
    return next((path for path in candidates if path.is_absolute() and path.is_file()), None)


def _vendor_folder(driver: Path) -> str:
    folder = removed_at_exit(Path(tempfile.mkdtemp(prefix="rhytid-opencl-")))
    for entry in sorted(SYSTEM_VENDORS.glob("*.icd")):
        (folder / entry.name).write_bytes(entry.read_bytes())
    (folder / _CPU_DRIVER).write_text(f"{driver}\n", encoding="utf-8")
    return str(folder)


cl: Any = _load_pyopencl()


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
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


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
            return cl.Program(context, text).build(options)
    finally:
        watch.end_call()
